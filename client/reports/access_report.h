#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/access.pb.h"

namespace lumifold::client {

/// "read", "submit", "admin". Errors: kInvalidArgument.
absl::StatusOr<v1::AccessScope> ParseScope(const std::string& name);

/// What WhoAmI, invites and identities are for people, and as JSON objects that end without a line break.
std::string WhoAmIText(const v1::WhoAmIResponse& caller);
std::string WhoAmIJson(const v1::WhoAmIResponse& caller);
std::string InviteJson(const v1::CreateInviteResponse& invite);
std::string IdentityTableHead();
std::string IdentityTableLine(const v1::Credential& credential);
std::string IdentityJson(const v1::Credential& credential);

}  // namespace lumifold::client
