#include "proto/rpc/byte_stream.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"

namespace lumifold::rpc {
namespace {

absl::StatusOr<uint64_t> SizeOf(const FileHandle& file, const std::string& path) {
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return FileError(path, errno);
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  return static_cast<uint64_t>(info.st_size);
}

}  // namespace

FileHandle::FileHandle(FileHandle&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

FileHandle& FileHandle::operator=(FileHandle&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

FileHandle::~FileHandle() {
  if (fd_ >= 0) close(fd_);
}

ByteSender::ByteSender(std::string path, FileHandle file, uint64_t offset, uint64_t size)
    : path_(std::move(path)), file_(std::move(file)), offset_(offset), size_(size) {}

absl::StatusOr<ByteSender> ByteSender::Open(const std::string& path, uint64_t offset) {
  FileHandle file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return FileError(path, errno);
  return OfFile(std::move(file), path, offset);
}

absl::StatusOr<ByteSender> ByteSender::OfFile(FileHandle file, const std::string& path, uint64_t offset) {
  const absl::StatusOr<uint64_t> size = SizeOf(file, path);
  if (!size.ok()) return size.status();
  if (offset > *size) {
    return absl::OutOfRangeError(absl::StrCat(path, ": offset ", offset, " is past its ", *size, " bytes"));
  }
  return ByteSender(path, std::move(file), offset, *size);
}

absl::StatusOr<bool> ByteSender::Next(v1::ByteChunk* chunk) {
  if (started_ && offset_ == size_) return false;
  chunk->Clear();
  if (!started_) chunk->set_sha256(sha256_);
  started_ = true;
  chunk->set_offset(offset_);
  chunk->set_total_size(size_);
  std::string* data = chunk->mutable_data();
  data->resize(std::min<uint64_t>(kMaxChunkBytes, size_ - offset_));
  const int64_t count = ReadAt(file_.get(), offset_, data->data(), data->size());
  if (count < 0) return FileError(path_, count);
  if (static_cast<size_t>(count) < data->size())
    return absl::DataLossError(absl::StrCat(path_, ": became shorter while it was read"));
  chunk->set_checksum(Checksum(*data));
  offset_ += data->size();
  return true;
}

ByteReceiver::ByteReceiver(std::string path, FileHandle file, uint64_t offset, FileSystem* files)
    : files_(files), path_(std::move(path)), file_(std::move(file)), offset_(offset) {}

absl::StatusOr<ByteReceiver> ByteReceiver::Open(const std::string& path, uint64_t offset, FileSystem* files) {
  const int opened = files->Open(path, O_WRONLY | O_CREAT);
  if (opened < 0) return FileError(path, opened);
  FileHandle file(opened);
  const absl::StatusOr<uint64_t> size = SizeOf(file, path);
  if (!size.ok()) return size.status();
  if (*size < offset) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": cannot continue at ", offset, ", the file has ", *size, " bytes"));
  }
  if (const int error = files->Truncate(opened, offset); error != 0) return FileError(path, error);
  return ByteReceiver(path, std::move(file), offset, files);
}

absl::Status ByteReceiver::CheckChunk(const v1::ByteChunk& chunk) const {
  if (chunk.offset() != offset_) {
    return absl::InvalidArgumentError(
        absl::StrCat(path_, ": piece at ", chunk.offset(), ", expected at ", offset_));
  }
  if (started_ && chunk.total_size() != total_size_) {
    return absl::InvalidArgumentError(
        absl::StrCat(path_, ": total size changed from ", total_size_, " to ", chunk.total_size()));
  }
  if (offset_ > chunk.total_size() || chunk.data().size() > kMaxChunkBytes ||
      chunk.data().size() > chunk.total_size() - offset_) {
    return absl::InvalidArgumentError(absl::StrCat(path_, ": piece at ", offset_, " is too long"));
  }
  if (chunk.data().empty() && offset_ != chunk.total_size()) {
    return absl::InvalidArgumentError(absl::StrCat(path_, ": piece at ", offset_, " is empty"));
  }
  if (chunk.checksum() != Checksum(chunk.data())) {
    return absl::DataLossError(
        absl::StrCat(path_, ": checksum of the piece at ", offset_, " does not match"));
  }
  return absl::OkStatus();
}

absl::Status ByteReceiver::Add(const v1::ByteChunk& chunk) {
  if (absl::Status status = CheckChunk(chunk); !status.ok()) return status;
  if (const int error = files_->Write(file_.get(), offset_, {chunk.data()}); error != 0)
    return FileError(path_, error);
  started_ = true;
  total_size_ = chunk.total_size();
  offset_ += chunk.data().size();
  return absl::OkStatus();
}

absl::Status ByteReceiver::Sync() {
  if (!IsComplete()) {
    return absl::FailedPreconditionError(
        absl::StrCat(path_, ": only ", offset_, " of ", total_size_, " bytes arrived"));
  }
  const int error = files_->Sync(file_.get());
  return error == 0 ? absl::OkStatus() : FileError(path_, error);
}

}  // namespace lumifold::rpc
