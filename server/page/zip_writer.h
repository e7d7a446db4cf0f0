#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace lumifold::page {

/// Writes an archive in the ZIP format (APPNOTE.TXT 6.3.10 of PKWARE) as a stream: members are stored as they
/// are, and the checksum of each follows it. Members and archives of 4 GiB and more have the 64-bit fields.
/// No library: libzip and minizip go back in the file to write checksums, which a stream cannot, and
/// libarchive brings libraries of XML, access lists and further codecs into the coordinator.
/// Threads: one at a time.
class ZipWriter {
 public:
  /// Bytes that begin a member of this many bytes. `name`: UTF-8, each once. It ends the member before.
  std::string Begin(const std::string& name, uint64_t size);
  /// Takes the next bytes of the member, which follow in the archive as they are.
  void Add(absl::string_view bytes);
  /// Bytes that end the archive. Of each member exactly its size must have been added.
  std::string End();

 private:
  struct Member {
    std::string name;
    uint64_t size = 0;
    uint64_t offset = 0;
    uint32_t crc = 0;
  };
  /// The checksum and sizes of the last member, which follow it.
  std::string Descriptor() const;
  static std::string DirectoryEntryOf(const Member& member);

  std::vector<Member> members_;
  uint64_t written_ = 0;
};

}  // namespace lumifold::page
