#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

/// An open file descriptor that closes itself. Move-only.
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

/// Reads a file as ByteChunks from an offset on. Gives at least one chunk, empty where nothing is left, so
/// that the receiver always learns the file's size. The size is taken once, at Open.
/// Threads: one at a time.
class ByteSender {
 public:
  /// Errors: kNotFound naming the path; kOutOfRange for an offset past the end; kUnavailable with the
  /// system's words.
  static absl::StatusOr<ByteSender> Open(const std::string& path, uint64_t offset);

  /// Fills `chunk` with the next piece; false when the last one has been given.
  /// Errors: kUnavailable; kDataLoss where the file has become shorter.
  absl::StatusOr<bool> Next(v1::ByteChunk* chunk);

 private:
  ByteSender(std::string path, FileHandle file, uint64_t offset, uint64_t size);

  std::string path_;
  FileHandle file_;
  uint64_t offset_;
  uint64_t size_;
  bool started_ = false;
};

/// Writes ByteChunks to a file, each checked before it is written.
/// Threads: one at a time.
class ByteReceiver {
 public:
  /// Opens `path`, made where it is missing, to go on at `offset`; what it holds from there on is cut off.
  /// Errors: kInvalidArgument where the file is shorter than offset; kUnavailable with the system's words.
  static absl::StatusOr<ByteReceiver> Open(const std::string& path, uint64_t offset);

  /// Takes the next piece.
  /// Errors: kInvalidArgument for a gap, an overlong piece, or a total size that changes or is overrun;
  /// kDataLoss when the checksum does not agree; kUnavailable when the disk refuses. Nothing wrong is ever
  /// written.
  absl::Status Add(const v1::ByteChunk& chunk);

  /// True once all bytes have been taken.
  bool IsComplete() const { return started_ && offset_ == total_size_; }

  /// Bytes of the file that are there.
  uint64_t offset() const { return offset_; }
  /// Size of the whole file; 0 before the first piece.
  uint64_t total_size() const { return total_size_; }

  /// Brings all bytes to the disk.
  /// Errors: kFailedPrecondition before the file is complete; kUnavailable when the disk refuses.
  absl::Status Sync();

 private:
  ByteReceiver(std::string path, FileHandle file, uint64_t offset);
  absl::Status CheckChunk(const v1::ByteChunk& chunk) const;

  std::string path_;
  FileHandle file_;
  uint64_t offset_;
  uint64_t total_size_ = 0;
  bool started_ = false;
};

}  // namespace lumifold::rpc
