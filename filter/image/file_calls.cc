#include "filter/image/file_calls.h"

#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <system_error>

#include "absl/strings/str_cat.h"

namespace lumifold {
namespace {

std::string TextOf(const std::string& path, int64_t error) {
  return absl::StrCat(path, ": ", std::system_category().message(static_cast<int>(std::abs(error))));
}

/// Calls `read` until no signal interrupts it.
template <typename Read>
int64_t Uninterrupted(const Read& read) {
  while (true) {
    const ssize_t count = read();
    if (count >= 0) return count;
    if (errno != EINTR) return -errno;
  }
}

}  // namespace

absl::Status FileError(const std::string& path, int64_t error) {
  const bool is_missing = std::abs(error) == ENOENT || std::abs(error) == ENOTDIR;
  return is_missing ? absl::NotFoundError(TextOf(path, error)) : StorageError(path, error);
}

absl::Status StorageError(const std::string& path, int64_t error) {
  return absl::UnavailableError(TextOf(path, error));
}

absl::Status WriteError(const std::string& path, int64_t error) {
  return StorageError(absl::StrCat("cannot write ", path), error);
}

int64_t ReadNext(int file, char* bytes, size_t size) {
  return Uninterrupted([=] { return read(file, bytes, size); });
}

int64_t ReadAt(int file, uint64_t offset, char* bytes, size_t size) {
  size_t done = 0;
  while (done < size) {
    const int64_t count = Uninterrupted(
        [&] { return pread(file, bytes + done, size - done, static_cast<off_t>(offset + done)); });
    if (count < 0) return count;
    if (count == 0) break;
    done += static_cast<size_t>(count);
  }
  return static_cast<int64_t>(done);
}

}  // namespace lumifold
