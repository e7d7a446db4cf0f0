#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "filter/image/file_system.h"

namespace lumifold::server {

/// A file that holds disk space. It is given up when the storage cannot be written, so that the ledger can
/// still record ends of jobs, and taken again before further units are committed.
/// Threads: one at a time.
class ReserveFile {
 public:
  /// 0 bytes: no reserve. `files` must outlive it.
  ReserveFile(std::string path, uint64_t bytes, FileSystem* files);

  /// Allocates the space, on the disk once it returns OK. No effect if it is held.
  /// Errors: kUnavailable naming the file and the missing bytes.
  absl::Status Take();
  /// Gives the space back. Errors are ignored: then it is still held by the file system, and Take tells.
  void GiveUp();

 private:
  const std::string path_;
  const uint64_t bytes_;
  FileSystem* const files_;
  bool held_ = false;
};

}  // namespace lumifold::server
