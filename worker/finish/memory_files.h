#pragma once

#include <map>
#include <string>

#include "absl/types/span.h"
#include "filter/image/file_system.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::worker {

/// Files without a folder, in memory: the sandbox leaves a worker no folder to write to.
/// Threads: one at a time.
class MemoryFiles final : public FileSystem {
 public:
  /// Takes a file out; it is gone from here. An invalid handle if there is none of this name.
  rpc::FileHandle Take(const std::string& path);

  /// Opens a file, or makes it.
  int Open(const std::string& path, int flags) override;
  int Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) override;
  int Truncate(int file, uint64_t size) override;
  int Allocate(int file, uint64_t size) override;
  int Sync(int /*file*/) override { return 0; }
  int SyncFolder(const std::string& /*folder*/) override { return 0; }
  int Rename(const std::string& from, const std::string& to) override;
  int Remove(const std::string& path) override;
  int MakeFolder(const std::string& /*path*/) override { return 0; }

 private:
  std::map<std::string, rpc::FileHandle> files_;
};

}  // namespace lumifold::worker
