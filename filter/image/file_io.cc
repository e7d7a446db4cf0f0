#include "filter/image/file_io.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <system_error>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"

namespace lumifold {
namespace {

absl::Status SystemError(const std::string& path, int error) {
  const std::string text = absl::StrCat(path, ": ", std::system_category().message(error));
  return error == ENOENT || error == ENOTDIR ? absl::NotFoundError(text) : absl::UnavailableError(text);
}

absl::Status WriteError(const std::string& path, int error) {
  return absl::UnavailableError(
      absl::StrCat("cannot write ", path, ": ", std::system_category().message(error)));
}

/// Reads `size` bytes, or up to the end if the file has become shorter. Returns 0 or errno.
int ReadAll(int file, std::string* bytes) {
  size_t done = 0;
  while (done < bytes->size()) {
    const ssize_t got = read(file, bytes->data() + done, bytes->size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return errno;
    if (got == 0) break;
    done += static_cast<size_t>(got);
  }
  bytes->resize(done);
  return 0;
}

}  // namespace

AtomicFile::AtomicFile(std::string path, std::string temporary, int file, FileSystem* files)
    : files_(files), path_(std::move(path)), temporary_(std::move(temporary)), file_(file) {}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : files_(other.files_),
      path_(std::move(other.path_)),
      temporary_(std::exchange(other.temporary_, std::string())),
      file_(std::exchange(other.file_, -1)) {}

AtomicFile::~AtomicFile() {
  if (file_ >= 0) close(file_);
  if (!temporary_.empty()) files_->Remove(temporary_);
}

absl::StatusOr<AtomicFile> AtomicFile::Create(const std::string& path, FileSystem* files) {
  static std::atomic<uint64_t> counter{0};
  std::string temporary = absl::StrCat(path, ".", getpid(), "-", counter.fetch_add(1), kPartialSuffix);
  const int file = files->Open(temporary, O_WRONLY | O_CREAT | O_EXCL);
  if (file < 0) return WriteError(path, -file);
  return AtomicFile(path, std::move(temporary), file, files);
}

absl::Status AtomicFile::Write(uint64_t offset, std::string_view bytes) {
  const int error = files_->Write(file_, offset, {bytes});
  return error == 0 ? absl::OkStatus() : WriteError(path_, -error);
}

absl::Status AtomicFile::Commit() {
  int error = files_->Sync(file_);
  if (close(std::exchange(file_, -1)) != 0 && error == 0) error = -errno;
  if (error == 0) error = files_->Rename(temporary_, path_);
  if (error != 0) return WriteError(path_, -error);
  temporary_.clear();
  error = files_->SyncFolder(FolderOf(path_));
  return error == 0 ? absl::OkStatus() : WriteError(path_, -error);
}

ScratchFile::ScratchFile(ScratchFile&& other) noexcept
    : folder_(std::move(other.folder_)), file_(std::exchange(other.file_, -1)) {}

ScratchFile::~ScratchFile() {
  if (file_ >= 0) close(file_);
}

absl::StatusOr<ScratchFile> ScratchFile::Create(const std::string& folder) {
  std::string path = absl::StrCat(folder, "/lumifold-scratch-XXXXXX");
  const int file = mkostemp(path.data(), O_CLOEXEC);
  if (file < 0) return WriteError(path, errno);
  unlink(path.c_str());
  return ScratchFile(folder, file);
}

absl::Status ScratchFile::Write(uint64_t offset, std::string_view bytes) {
  const int error = RealFileSystem()->Write(file_, offset, {bytes});
  return error == 0 ? absl::OkStatus() : WriteError(absl::StrCat("a scratch file in ", folder_), -error);
}

absl::Status ScratchFile::Read(uint64_t offset, char* bytes, size_t count) const {
  while (count > 0) {
    const ssize_t got = pread(file_, bytes, count, static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      return absl::UnavailableError(
          absl::StrCat("cannot read a scratch file in ", folder_, ": ",
                       got < 0 ? std::system_category().message(errno) : "cut short"));
    }
    bytes += got;
    count -= static_cast<size_t>(got);
    offset += static_cast<uint64_t>(got);
  }
  return absl::OkStatus();
}

void ScratchFile::Forget(uint64_t offset) {
  fallocate(file_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, static_cast<off_t>(offset));
}

absl::Status WriteFileAtomically(const std::string& path, std::string_view bytes, FileSystem* files) {
  absl::StatusOr<AtomicFile> file = AtomicFile::Create(path, files);
  if (!file.ok()) return file.status();
  if (absl::Status status = file->Write(0, bytes); !status.ok()) return status;
  return file->Commit();
}

absl::Status CheckIsFile(const std::string& path) {
  struct stat info;
  if (stat(path.c_str(), &info) != 0) return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  return absl::OkStatus();
}

absl::StatusOr<std::string> ReadFile(const std::string& path, int64_t max_bytes) {
  const int file =
      open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe without a writer must not block us
  if (file < 0) return SystemError(path, errno);
  const auto close_file = absl::MakeCleanup([file] { close(file); });
  struct stat info;
  if (fstat(file, &info) != 0) return SystemError(path, errno);
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  if (info.st_size > max_bytes) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", info.st_size, " bytes, more than the ", max_bytes, " allowed"));
  }
  std::string bytes(static_cast<size_t>(info.st_size), '\0');
  if (const int error = ReadAll(file, &bytes); error != 0) return SystemError(path, error);
  return bytes;
}

}  // namespace lumifold
