#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold::identity {

/// Creates a folder and its missing parents, those for the user alone (0700).
/// Errors of these: kUnavailable with the path and the system's message; never with the content.
absl::Status MakePrivateFolder(const std::string& path);

/// Replaces the content of `path` at once. The file is never readable by others (0600), not even while it is
/// written.
absl::Status WritePrivateFile(const std::string& path, std::string_view bytes);

/// The whole file.
/// Errors: kNotFound; kFailedPrecondition where others than the user can read or write it, or it belongs to
/// another user, unless the program is root's; kInvalidArgument for what is no regular file, a link included,
/// or larger than `max_bytes`.
absl::StatusOr<std::string> ReadPrivateFile(const std::string& path, int64_t max_bytes);

}  // namespace lumifold::identity
