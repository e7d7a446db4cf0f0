#pragma once

#include <functional>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/access/identity.h"
#include "server/access/known_credentials.h"

namespace grpc {
class AuthMetadataProcessor;
}  // namespace grpc

namespace lumifold::access {

/// Metadata of a call that is made inside the process in the name of a person: its credential, as
/// Identity::id. Calls from outside that have it are not heard.
inline constexpr char kInNameOfKey[] = "lumifold-in-name-of";

/// Threads: called on threads that serve connections; must not block.
using RefusalListener =
    std::function<void(const Identity& caller, absl::string_view rpc_path, const absl::Status& why)>;

/// Who calls is known before any message of the call is parsed: calls without identity, and those that
/// `authoriser` refuses, end here. Calls that the table of authorisation opens to nobody in particular need
/// none, and streams of requests pass: their service refuses them before it reads. `on_refusal` is told of
/// each call that ends here; its caller has no name where it is not known, and the path is one of the table
/// or empty. All that the arguments name must outlive the processor; it is part of the credentials of a
/// server.
std::shared_ptr<grpc::AuthMetadataProcessor> MakeCallerCheck(const KnownCredentials* known,
                                                             const Authoriser* authoriser,
                                                             std::function<absl::Time()> wall_now,
                                                             RefusalListener on_refusal);

/// Callers of a server with that check. `known` must outlive it.
std::unique_ptr<Callers> MakeCallers(const KnownCredentials* known, std::function<absl::Time()> wall_now);

/// Callers of a server in plain text, or inside the process: all are LocalIdentity.
std::unique_ptr<Callers> MakeLocalCallers();

}  // namespace lumifold::access
