#include "filter/image/file_system.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <vector>

namespace lumifold {
namespace {

int ErrorOr0(int result) { return result == 0 ? 0 : -errno; }

/// The parts of `pieces` after their first `done` bytes, at most as many as one call takes.
std::vector<iovec> Remaining(absl::Span<const std::string_view> pieces, size_t done) {
  std::vector<iovec> parts;
  for (std::string_view piece : pieces) {
    const size_t skipped = std::min(done, piece.size());
    done -= skipped;
    piece.remove_prefix(skipped);
    // pwritev only reads the bytes.
    if (!piece.empty()) parts.push_back({const_cast<char*>(piece.data()), piece.size()});
    if (parts.size() == IOV_MAX) break;
  }
  return parts;
}

class RealFiles final : public FileSystem {
 public:
  RealFiles(mode_t file_mode, mode_t folder_mode) : file_mode_(file_mode), folder_mode_(folder_mode) {}

  bool IsPrivate() const override { return (file_mode_ & 077) == 0; }

  int Open(const std::string& path, int flags) override {
    while (true) {
      const int file = open(path.c_str(), flags | O_CLOEXEC, file_mode_);
      if (file >= 0 || errno != EINTR) return file >= 0 ? file : -errno;
    }
  }

  int Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) override {
    size_t done = 0;
    while (true) {
      const std::vector<iovec> parts = Remaining(pieces, done);
      if (parts.empty()) return 0;
      const ssize_t n =
          pwritev(file, parts.data(), static_cast<int>(parts.size()), static_cast<off_t>(offset + done));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return -errno;
      done += static_cast<size_t>(n);
    }
  }

  int Truncate(int file, uint64_t size) override {
    return ErrorOr0(ftruncate(file, static_cast<off_t>(size)));
  }

  int Allocate(int file, uint64_t size) override {
    // fallocate(2), not posix_fallocate, which would write every block where the file system cannot reserve.
    const int error = ErrorOr0(fallocate(file, 0, 0, static_cast<off_t>(size)));
    return error == -EOPNOTSUPP ? Truncate(file, size) : error;
  }

  int Sync(int file) override { return ErrorOr0(fdatasync(file)); }

  int SyncFolder(const std::string& folder) override {
    const int handle = Open(folder, O_RDONLY | O_DIRECTORY);
    if (handle < 0) return handle;
    const int error = ErrorOr0(fsync(handle));
    close(handle);
    return error == -EINVAL ? 0 : error;  // some file systems cannot sync a folder and need not
  }

  int Rename(const std::string& from, const std::string& to) override {
    return ErrorOr0(std::rename(from.c_str(), to.c_str()));
  }

  int Remove(const std::string& path) override { return ErrorOr0(std::remove(path.c_str())); }

  int MakeFolder(const std::string& path) override {
    const int error = ErrorOr0(mkdir(path.c_str(), folder_mode_));
    return error == -EEXIST ? 0 : error;
  }

 private:
  const mode_t file_mode_;
  const mode_t folder_mode_;
};

}  // namespace

FileSystem* RealFileSystem() {
  static RealFiles files(0666, 0777);
  return &files;
}

FileSystem* PrivateFileSystem() {
  static RealFiles files(0600, 0700);
  return &files;
}

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

std::string NameBeside(const std::string& path, std::string_view suffix) {
  const size_t name = path.rfind('/') + 1;  // 0 without a folder
  const size_t most = NAME_MAX > suffix.size() ? NAME_MAX - suffix.size() : 0;
  return std::string(path, 0, name + std::min(path.size() - name, most)).append(suffix);
}

std::string FileBehind(const std::string& path) {
  std::string file = path;
  for (int links = 0; links < 40; ++links) {  // a circle of links is replaced
    std::error_code error;
    const std::filesystem::path target = std::filesystem::read_symlink(file, error);
    if (error) return file;
    file = (std::filesystem::path(file).parent_path() / target).string();
  }
  return file;
}

}  // namespace lumifold
