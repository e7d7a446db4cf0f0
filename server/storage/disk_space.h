#pragma once

#include <cstdint>
#include <string>

namespace lumifold::server {

/// Space that uploads and films leave free, so that units and results can still be written: a twentieth of
/// the disk, at most 2 GiB. With half of it a farm that commits 400 MB/s has 2.5 s less to react; twice as
/// much is withheld from small disks.
inline constexpr uint64_t kDiskShareKept = 20;
inline constexpr uint64_t kMaxDiskBytesKept = uint64_t{2} << 30;

struct DiskSpace {
  uint64_t free_bytes = 0;
  uint64_t kept_bytes = 0;  // of them, those that uploads and films leave free

  /// What uploads and films may take.
  uint64_t room() const { return free_bytes > kept_bytes ? free_bytes - kept_bytes : 0; }
};

/// The disk that `folder` is on; nothing is free where it cannot be asked.
DiskSpace DiskSpaceOf(const std::string& folder);

}  // namespace lumifold::server
