#include "worker/finish/memory_files.h"

#include <fcntl.h>
#include <sys/mman.h>

#include <cerrno>
#include <utility>

namespace lumifold::worker {

rpc::FileHandle MemoryFiles::Take(const std::string& path) {
  const auto found = files_.find(path);
  if (found == files_.end()) return rpc::FileHandle();
  return std::move(files_.extract(found).mapped());
}

int MemoryFiles::Open(const std::string& path, int /*flags*/) {
  auto found = files_.find(path);
  if (found == files_.end()) {
    rpc::FileHandle file(memfd_create("lumifold", MFD_CLOEXEC));
    if (file.get() < 0) return -errno;
    found = files_.emplace(path, std::move(file)).first;
  }
  const int own = fcntl(found->second.get(), F_DUPFD_CLOEXEC, 0);
  return own < 0 ? -errno : own;
}

int MemoryFiles::Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) {
  return RealFileSystem()->Write(file, offset, pieces);
}

int MemoryFiles::Truncate(int file, uint64_t size) { return RealFileSystem()->Truncate(file, size); }

int MemoryFiles::Allocate(int file, uint64_t size) { return RealFileSystem()->Allocate(file, size); }

int MemoryFiles::Rename(const std::string& from, const std::string& to) {
  const auto found = files_.find(from);
  if (found == files_.end()) return -ENOENT;
  rpc::FileHandle file = std::move(files_.extract(found).mapped());
  files_.insert_or_assign(to, std::move(file));
  return 0;
}

int MemoryFiles::Remove(const std::string& path) { return files_.erase(path) == 1 ? 0 : -ENOENT; }

}  // namespace lumifold::worker
