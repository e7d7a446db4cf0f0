#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold {

/// Writes `bytes` so that `path` holds either the old content or all of the new one, whatever happens:
/// temporary file beside it, fsync, rename, fsync of the folder. Errors: kUnavailable with path and the
/// system's words.
absl::Status WriteFileAtomically(const std::string& path, std::string_view bytes);

/// The whole file. Errors: kNotFound; kInvalidArgument for a folder or a file over `max_bytes`; kUnavailable
/// otherwise.
absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes);

}  // namespace lumifold
