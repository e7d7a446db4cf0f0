#include "proto/identity/private_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "filter/image/file_io.h"
#include "filter/image/file_system.h"

namespace lumifold::identity {
namespace {

constexpr mode_t kOnlyUserFolder = 0700;

absl::Status CheckIsPrivate(const std::string& path, const struct stat& info, int64_t max_bytes) {
  if (!S_ISREG(info.st_mode)) return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  if (info.st_uid != geteuid() && geteuid() != 0)
    return absl::FailedPreconditionError(absl::StrCat(path, ": belongs to another user"));
  if ((info.st_mode & 077) != 0) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": other users have access to it; it holds a secret: chmod 600"));
  }
  if (info.st_size > max_bytes)
    return absl::InvalidArgumentError(absl::StrCat(path, ": larger than ", max_bytes, " bytes"));
  return absl::OkStatus();
}

}  // namespace

absl::Status MakePrivateFolder(const std::string& path) {
  if (mkdir(path.c_str(), kOnlyUserFolder) == 0) return absl::OkStatus();
  if (errno == ENOENT) {
    const std::string parent = FolderOf(path);
    if (parent == path) return WriteError(path, ENOENT);
    if (absl::Status status = MakePrivateFolder(parent); !status.ok()) return status;
    if (mkdir(path.c_str(), kOnlyUserFolder) == 0) return absl::OkStatus();
  }
  if (errno != EEXIST) return WriteError(path, errno);
  struct stat info = {};
  if (stat(path.c_str(), &info) != 0) return WriteError(path, errno);
  return S_ISDIR(info.st_mode) ? absl::OkStatus() : WriteError(path, ENOTDIR);
}

absl::Status WritePrivateFile(const std::string& path, std::string_view bytes) {
  return WriteFileAtomically(path, bytes, PrivateFileSystem());
}

absl::StatusOr<std::string> ReadPrivateFile(const std::string& path, int64_t max_bytes) {
  // Non-blocking: opening a pipe would wait for a writer.
  const int file = open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (file < 0 && errno == ELOOP)
    return absl::InvalidArgumentError(absl::StrCat(path, ": not a regular file"));
  if (file < 0) return FileError(path, errno);
  const absl::Cleanup close_file = [file] { close(file); };
  struct stat info = {};
  if (fstat(file, &info) != 0) return FileError(path, errno);
  if (absl::Status status = CheckIsPrivate(path, info, max_bytes); !status.ok()) return status;
  std::string bytes(static_cast<size_t>(info.st_size), '\0');
  const int64_t got = ReadAt(file, 0, bytes.data(), bytes.size());
  if (got < 0) return FileError(path, got);
  bytes.resize(static_cast<size_t>(got));
  return bytes;
}

}  // namespace lumifold::identity
