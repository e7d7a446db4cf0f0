#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace lumifold {

/// What an AtomicFile's name ends with until it is whole, even where its process was killed.
inline constexpr char kPartialSuffix[] = ".partial";

/// A file that comes into being whole or not at all: written beside its place, moved there at the end. Gone
/// without a trace where it is destroyed before. Errors: kUnavailable with path and the system's words.
class AtomicFile {
 public:
  static absl::StatusOr<AtomicFile> Create(const std::string& path);
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  absl::Status Write(uint64_t offset, std::string_view bytes);
  /// Forces all to the disk and gives the file its name. Once.
  absl::Status Commit();

 private:
  AtomicFile(std::string path, std::string temporary, int file);

  std::string path_;
  std::string temporary_;  // empty: there is none any more
  int file_ = -1;
};

/// A nameless file for what does not fit into memory; it goes with its owner, or with the process. Errors:
/// kUnavailable with the folder's name and the system's words. Threads: safe.
class ScratchFile {
 public:
  static absl::StatusOr<ScratchFile> Create(const std::string& folder);
  ScratchFile(ScratchFile&& other) noexcept;
  ScratchFile& operator=(ScratchFile&&) = delete;
  ~ScratchFile();

  absl::Status Write(uint64_t offset, std::string_view bytes);
  /// Reads what was written there.
  absl::Status Read(uint64_t offset, char* bytes, size_t count) const;
  /// Gives the room of everything before `offset` back, where the file system can.
  void Forget(uint64_t offset);

 private:
  ScratchFile(std::string folder, int file) : folder_(std::move(folder)), file_(file) {}

  std::string folder_;
  int file_ = -1;
};

/// Writes `bytes` so that `path` holds either the old content or all of the new one, whatever happens:
/// temporary file beside it, fsync, rename, fsync of the folder. Errors: kUnavailable with path and the
/// system's words.
absl::Status WriteFileAtomically(const std::string& path, std::string_view bytes);

/// Whether `path` is a regular file. Errors: kNotFound; kInvalidArgument.
absl::Status CheckIsFile(const std::string& path);

/// The whole file. Errors: kNotFound; kInvalidArgument for a folder or a file over `max_bytes`; kUnavailable
/// otherwise.
absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes);

}  // namespace lumifold
