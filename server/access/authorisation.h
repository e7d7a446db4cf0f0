#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/types/span.h"
#include "server/access/identity.h"

namespace lumifold::access {

/// What a caller is. A person's role is that of the highest of its scopes, which includes those below.
enum class Role {
  kNobody,  // no valid identity
  kRead,
  kSubmit,
  kAdmin,
  kWorker,
  kLocal,
};
inline constexpr std::array kRoles = {Role::kNobody, Role::kRead,   Role::kSubmit,
                                      Role::kAdmin,  Role::kWorker, Role::kLocal};
absl::string_view NameOf(Role role);
/// A person without scopes is nobody.
Role RoleOf(const Identity& caller);

/// What a role may do with a call.
enum class Access {
  kNo,
  kOwn,  // for its own jobs; those of others do not exist for it
  kYes,
};

/// A row of the table of all calls.
struct Rule {
  absl::string_view rpc_path;  // "/lumifold.v1.FarmService/GetJob"
  std::array<Access, kRoles.size()> access;
  /// The call changes something, so that it is in the audit log.
  bool changes = false;
  /// Nothing of the call is parsed before the service asks who calls: the service refuses it, and knows the
  /// address.
  bool checked_by_service = false;
};

/// By service and call.
absl::Span<const Rule> Rules();
/// Null for a call that has no row; nobody may make it.
const Rule* FindRule(absl::string_view rpc_path);
Access AccessOf(Role role, absl::string_view rpc_path);

/// Whether the caller may see and change the jobs of others.
bool ReachesAllJobs(const Identity& caller);

/// Lets a caller make the calls for which its role has a yes or its own jobs. Never blocks.
std::unique_ptr<Authoriser> MakeAuthoriser();

}  // namespace lumifold::access
