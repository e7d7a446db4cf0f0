#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/file_system.h"

namespace lumifold::rpc {

/// A file that a program keeps for itself: 4 bytes that name its type and, last, its version, the XXH3-64 of
/// the rest as a little-endian number, and the content.
struct CheckedFileType {
  const char* magic;
  const char* name;  // for errors, "the manifest"
  int64_t max_bytes;
};

/// Replaces the file as a whole; durable once it returns OK.
/// Errors: kUnavailable naming the file.
absl::Status WriteCheckedFile(const std::string& path, const CheckedFileType& type,
                              const std::string& content, FileSystem* files);
/// The content.
/// Errors: kNotFound; kDataLoss where it is damaged or of another type or version; kInvalidArgument over the
/// type's size; kUnavailable. All name the file.
absl::StatusOr<std::string> ReadCheckedFile(const std::string& path, const CheckedFileType& type);

}  // namespace lumifold::rpc
