#include "proto/rpc/checked_file.h"

#include <cstring>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "proto/rpc/checksum.h"

namespace lumifold::rpc {

absl::Status WriteCheckedFile(const std::string& path, const CheckedFileType& type,
                              const std::string& content, FileSystem* files) {
  const uint64_t checksum = Checksum(content);
  std::string bytes(type.magic);
  bytes.append(reinterpret_cast<const char*>(&checksum), sizeof(checksum)).append(content);
  return WriteFileAtomically(path, bytes, files);
}

absl::StatusOr<std::string> ReadCheckedFile(const std::string& path, const CheckedFileType& type) {
  absl::StatusOr<std::string> bytes = ReadFile(path, type.max_bytes);
  if (!bytes.ok()) return bytes;
  const absl::Status damaged = absl::DataLossError(absl::StrCat(path, ": ", type.name, " is damaged"));
  const std::string_view magic(type.magic);
  uint64_t checksum = 0;
  const size_t head = magic.size() + sizeof(checksum);
  if (bytes->size() < head) return damaged;
  if (!std::string_view(*bytes).starts_with(magic)) {
    const std::string_view family = magic.substr(0, magic.size() - 1);  // the last byte is the version
    if (!std::string_view(*bytes).starts_with(family)) return damaged;
    return absl::DataLossError(absl::StrCat(path, ": ", type.name, " was written by another version"));
  }
  std::memcpy(&checksum, bytes->data() + magic.size(), sizeof(checksum));
  bytes->erase(0, head);
  if (Checksum(*bytes) != checksum) return damaged;
  return bytes;
}

}  // namespace lumifold::rpc
