#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/access/access_control.h"

namespace lumifold::access {

/// Sets up access control of a coordinator. Returns the three commands to type: on this machine, on that of
/// the first administrator and on a worker's. They have one-time codes: they are shown, and kept nowhere.
/// `data_dir`: the coordinator's data folder. `names`: hosts by which others reach it; empty: this machine's
/// host name.
/// Errors: those of MakeAccessFolder.
absl::StatusOr<std::string> SetUp(const AccessOptions& options, const std::string& data_dir,
                                  std::vector<std::string> names);

/// A code for one more administrator, for when no token of one is left.
absl::StatusOr<std::string> InviteAdmin(const AccessOptions& options, const std::string& name);

}  // namespace lumifold::access
