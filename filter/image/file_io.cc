#include "filter/image/file_io.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"

namespace lumifold {

namespace {

/// Gives a new file the mode of the one that it will replace, if there is one. Where that is not allowed the
/// file keeps its own.
void TakeMode(const std::string& replaced, int file) {
  struct stat info;
  if (stat(replaced.c_str(), &info) != 0 || !S_ISREG(info.st_mode)) return;
  if (fchmod(file, info.st_mode & 0777) != 0) return;
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
  const std::string target = files->IsPrivate() ? path : FileBehind(path);
  std::string temporary =
      NameBeside(target, absl::StrCat(".", getpid(), "-", counter.fetch_add(1), kPartialSuffix));
  const int file = files->Open(temporary, O_WRONLY | O_CREAT | O_EXCL);
  if (file < 0) return WriteError(path, file);
  if (!files->IsPrivate()) TakeMode(target, file);
  return AtomicFile(target, std::move(temporary), file, files);
}

absl::Status AtomicFile::Write(uint64_t offset, std::string_view bytes) {
  const int error = files_->Write(file_, offset, {bytes});
  return error == 0 ? absl::OkStatus() : WriteError(path_, error);
}

absl::Status AtomicFile::Commit() {
  int error = files_->Sync(file_);
  if (close(std::exchange(file_, -1)) != 0 && error == 0) error = -errno;
  if (error == 0) error = files_->Rename(temporary_, path_);
  if (error != 0) return WriteError(path_, error);
  temporary_.clear();
  error = files_->SyncFolder(FolderOf(path_));
  return error == 0 ? absl::OkStatus() : WriteError(path_, error);
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
  return error == 0 ? absl::OkStatus() : WriteError(absl::StrCat("a scratch file in ", folder_), error);
}

absl::Status ScratchFile::Read(uint64_t offset, char* bytes, size_t count) const {
  const std::string name = absl::StrCat("cannot read a scratch file in ", folder_);
  const int64_t got = ReadAt(file_, offset, bytes, count);
  if (got < 0) return StorageError(name, got);
  if (static_cast<size_t>(got) < count) return absl::UnavailableError(absl::StrCat(name, ": cut short"));
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

absl::Status MoveIntoPlace(const std::string& from, const std::string& to) {
  const std::string target = FileBehind(to);
  const int file = open(from.c_str(), O_RDONLY | O_CLOEXEC);
  if (file >= 0) {
    TakeMode(target, file);
    close(file);
  }
  const int error = RealFileSystem()->Rename(from, target);
  return error == 0 ? absl::OkStatus() : WriteError(to, error);
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
  if (file < 0) return FileError(path, errno);
  const auto close_file = absl::MakeCleanup([file] { close(file); });
  struct stat info;
  if (fstat(file, &info) != 0) return FileError(path, errno);
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  if (info.st_size > max_bytes) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", info.st_size, " bytes, more than the ", max_bytes, " allowed"));
  }
  std::string bytes(static_cast<size_t>(info.st_size), '\0');
  const int64_t got = ReadAt(file, 0, bytes.data(), bytes.size());
  if (got < 0) return FileError(path, got);
  bytes.resize(static_cast<size_t>(got));  // it may have become shorter
  return bytes;
}

}  // namespace lumifold
