#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace lumifold {

// Errors of calls on files: "PATH: text of the system". `error` is the number (errno) or, as FileSystem and
// the calls below return it, minus that number.

/// kNotFound where there is no such file or folder, otherwise kUnavailable.
absl::Status FileError(const std::string& path, int64_t error);
/// kUnavailable, whatever the error: of a file or folder that must be there.
absl::Status StorageError(const std::string& path, int64_t error);
/// kUnavailable: "cannot write PATH: ...".
absl::Status WriteError(const std::string& path, int64_t error);

/// Reads from the file's position on, as read(2). Returns the number of bytes, 0 at the end; or minus the
/// error number.
int64_t ReadNext(int file, char* bytes, size_t size);
/// Reads from `offset` on until there are `size` bytes or the file ends. Returns their number, or minus the
/// error number.
int64_t ReadAt(int file, uint64_t offset, char* bytes, size_t size);

}  // namespace lumifold
