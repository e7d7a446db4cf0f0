#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/file_system.h"

namespace lumifold::film {

/// The SHA-256 of a result file, 64 lower-case hexadecimal digits. It is computed once, after the result is
/// written, and kept beside it as RESULT.sha256; so a result that changes later does not match. For a result
/// of an older version it is computed at the first call.
/// Errors: kNotFound naming the result; kUnavailable with the system's message.
/// Threads: safe.
absl::StatusOr<std::string> ResultDigest(const std::string& result_path);

/// Computes and keeps the SHA-256 of a result that was just written, also where an earlier one is kept.
/// Errors: as ResultDigest.
absl::StatusOr<std::string> MakeResultDigest(const std::string& result_path,
                                             FileSystem* files = PrivateFileSystem());

/// Keeps the SHA-256 that a result had when it arrived. Errors: as ResultDigest.
absl::Status WriteResultDigest(const std::string& result_path, const std::string& digest, FileSystem* files);

}  // namespace lumifold::film
