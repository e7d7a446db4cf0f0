#include "server/storage/disk_space.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace lumifold::server {

DiskSpace DiskSpaceOf(const std::string& folder) {
  std::error_code error;
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  if (error) return {};
  return {space.available, std::min<uint64_t>(space.capacity / kDiskShareKept, kMaxDiskBytesKept)};
}

}  // namespace lumifold::server
