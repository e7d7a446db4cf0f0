#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace lumifold::webhooks {

/// The secret that messages are signed with: the first line of a file.
/// Errors: those of identity::ReadPrivateFile; kInvalidArgument for one of fewer than 16 characters.
absl::StatusOr<std::string> ReadSecret(const std::string& path);

/// The same, of a file that is made if it is missing: 64 hexadecimal digits. Several coordinators may do so
/// at the same time.
absl::StatusOr<std::string> ReadOrMakeSecret(const std::string& path);

}  // namespace lumifold::webhooks
