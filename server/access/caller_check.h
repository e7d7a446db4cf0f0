#pragma once

#include <functional>
#include <memory>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/access/identity.h"
#include "server/access/known_credentials.h"

namespace grpc {
class AuthMetadataProcessor;
}  // namespace grpc

namespace lumifold::access {

/// Who calls is known before any message of the call is parsed: calls without identity, and those that `authoriser`
/// refuses, end here. Calls that the table of authorisation opens to nobody in
/// particular need none. All arguments must outlive the processor; it is part of the credentials of a server.
std::shared_ptr<grpc::AuthMetadataProcessor> MakeCallerCheck(const KnownCredentials* known,
                                                             const Authoriser* authoriser,
                                                             std::function<absl::Time()> wall_now);

/// Callers of a server with that check. `known` must outlive it.
std::unique_ptr<Callers> MakeCallers(const KnownCredentials* known, std::function<absl::Time()> wall_now);

/// Callers of a server in plain text, or inside the process: all are LocalIdentity.
std::unique_ptr<Callers> MakeLocalCallers();

}  // namespace lumifold::access
