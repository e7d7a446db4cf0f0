#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/file_system.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

/// Owns a file descriptor. Move-only.
class FileHandle {
 public:
  FileHandle() = default;
  explicit FileHandle(int fd) : fd_(fd) {}
  FileHandle(FileHandle&& other) noexcept;
  FileHandle& operator=(FileHandle&& other) noexcept;
  ~FileHandle();

  int get() const { return fd_; }

 private:
  int fd_ = -1;
};

/// Reads a file as ByteChunks from an offset on. Returns at least one chunk, which is empty at the end of the
/// file, so that the receiver always gets the file's size. The size is read once, at Open.
/// Threads: one at a time.
class ByteSender {
 public:
  /// Errors: kNotFound naming the path; kOutOfRange for an offset past the end; kUnavailable with the
  /// system's message.
  static absl::StatusOr<ByteSender> Open(const std::string& path, uint64_t offset);
  /// The same for a file that is open; `path` is for messages.
  static absl::StatusOr<ByteSender> OfFile(FileHandle file, const std::string& path, uint64_t offset);

  /// States the SHA-256 of the whole file on the first chunk. Call it before Next.
  void SetSha256(std::string sha256) { sha256_ = std::move(sha256); }

  /// Fills `chunk` with the next piece; false after the last one.
  /// Errors: kUnavailable; kDataLoss if the file has become shorter.
  absl::StatusOr<bool> Next(v1::ByteChunk* chunk);

 private:
  ByteSender(std::string path, FileHandle file, uint64_t offset, uint64_t size);

  std::string path_;
  FileHandle file_;
  uint64_t offset_;
  uint64_t size_;
  std::string sha256_;
  bool started_ = false;
};

/// Writes ByteChunks to a file. Each chunk is checked before it is written.
/// Threads: one at a time.
class ByteReceiver {
 public:
  /// Opens or creates `path` for writing at `offset` and truncates it there.
  /// Errors: kInvalidArgument if the file is shorter than `offset`; kUnavailable with the system's message.
  /// `files` must outlive it.
  static absl::StatusOr<ByteReceiver> Open(const std::string& path, uint64_t offset,
                                           FileSystem* files = RealFileSystem());

  /// Writes the next piece.
  /// Errors: kInvalidArgument for a gap, a piece that is too long, or a total size that changes or is
  /// exceeded; kDataLoss when the checksum does not match; kUnavailable for a disk error. An invalid piece is
  /// not written.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// True after the last byte.
  bool IsComplete() const { return started_ && offset_ == total_size_; }

  /// Number of bytes written so far, including those before the first piece.
  uint64_t offset() const { return offset_; }
  /// Size of the whole file; 0 before the first piece.
  uint64_t total_size() const { return total_size_; }

  /// Waits until all bytes are on the disk (fsync).
  /// Errors: kFailedPrecondition before the file is complete; kUnavailable for a disk error.
  absl::Status Sync();

 private:
  ByteReceiver(std::string path, FileHandle file, uint64_t offset, FileSystem* files);
  absl::Status CheckChunk(const v1::ByteChunk& chunk) const;

  FileSystem* files_;
  std::string path_;
  FileHandle file_;
  uint64_t offset_;
  uint64_t total_size_ = 0;
  bool started_ = false;
};

}  // namespace lumifold::rpc
