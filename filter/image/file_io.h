#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/file_system.h"

namespace lumifold {

/// Suffix of an AtomicFile's name until it is complete; it also marks the leftovers of a killed process.
inline constexpr char kPartialSuffix[] = ".partial";

/// A file that is written atomically: it is written under a temporary name and renamed at the end. If the
/// object is destroyed before that, the temporary file is deleted. It has the mode of the file that it
/// replaces; a symbolic link stays, and what it names is replaced. Private files (FileSystem::IsPrivate) do
/// neither.
/// Errors: kUnavailable with path and system message.
class AtomicFile {
 public:
  /// `files` must outlive it.
  static absl::StatusOr<AtomicFile> Create(const std::string& path, FileSystem* files = RealFileSystem());
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  absl::Status Write(uint64_t offset, std::string_view bytes);
  /// Syncs the file to disk and renames it to its path. Call once.
  absl::Status Commit();

 private:
  AtomicFile(std::string path, std::string temporary, int file, FileSystem* files);

  FileSystem* files_;
  std::string path_;
  std::string temporary_;  // empty once renamed or deleted
  int file_ = -1;
};

/// An unnamed file for data that does not fit into memory. It vanishes with its owner or the process.
/// Errors:  kUnavailable with the folder's name and the system's message.
/// Threads: safe.
class ScratchFile {
 public:
  static absl::StatusOr<ScratchFile> Create(const std::string& folder);
  ScratchFile(ScratchFile&& other) noexcept;
  ScratchFile& operator=(ScratchFile&&) = delete;
  ~ScratchFile();

  absl::Status Write(uint64_t offset, std::string_view bytes);
  /// Reads bytes that were written before.
  absl::Status Read(uint64_t offset, char* bytes, size_t count) const;
  /// Frees the disk space of everything before `offset`, if the file system supports it.
  void Forget(uint64_t offset);

 private:
  ScratchFile(std::string folder, int file) : folder_(std::move(folder)), file_(file) {}

  std::string folder_;
  int file_ = -1;
};

/// Replaces the content of `path` atomically: temporary file in the same folder, fsync, rename, fsync of the
/// folder. After a crash `path` holds either the old content or all of the new.
/// Errors: kUnavailable with path and the system's message.
absl::Status WriteFileAtomically(const std::string& path, std::string_view bytes,
                                 FileSystem* files = RealFileSystem());

/// Renames the complete file `from` to `to`, as AtomicFile does, within one file system.
absl::Status MoveIntoPlace(const std::string& from, const std::string& to);

/// Whether `path` is a regular file.
/// Errors: kNotFound; kInvalidArgument.
absl::Status CheckIsFile(const std::string& path);

/// The whole file.
/// Errors: kNotFound; kInvalidArgument for a folder or a file over `max_bytes`; kUnavailable otherwise.
absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes);

}  // namespace lumifold
