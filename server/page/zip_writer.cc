#include "server/page/zip_writer.h"

#include <zlib.h>

#include "absl/strings/str_cat.h"

namespace lumifold::page {
namespace {

constexpr uint32_t kMost32 = 0xffffffff;
constexpr uint16_t kMost16 = 0xffff;
/// Version 4.5 has 64-bit fields.
constexpr uint16_t kVersion = 45;
/// Sizes and checksum follow the member; its name is UTF-8.
constexpr uint16_t kFlags = 0x0808;
constexpr uint16_t kStored = 0;
/// 1980-01-01, the format's first day: equal frames are equal archives.
constexpr uint16_t kTime = 0;
constexpr uint16_t kDate = 0x21;
constexpr uint16_t kExtra64 = 1;
/// Of a member in the directory: comment, disk and attributes.
constexpr size_t kUnusedBytes = 10;

/// Numbers with the lowest byte first.
template <typename Number>
std::string Bytes(Number number) {
  std::string bytes;
  for (size_t i = 0; i < sizeof(Number); ++i) bytes += static_cast<char>(number >> (8 * i) & 0xff);
  return bytes;
}

bool Is64(uint64_t number) { return number >= kMost32; }

/// A field of 32 bits, or the mark that an extra one has it.
std::string Bytes32(uint64_t number) { return Bytes(Is64(number) ? kMost32 : static_cast<uint32_t>(number)); }

/// From the version that is needed to the date.
std::string CommonFields() {
  return absl::StrCat(Bytes(kVersion), Bytes(kFlags), Bytes(kStored), Bytes(kTime), Bytes(kDate));
}

}  // namespace

std::string ZipWriter::Begin(const std::string& name, uint64_t size) {
  std::string bytes = Descriptor();
  members_.push_back({.name = name, .size = size, .offset = written_ + bytes.size()});
  const std::string extra =
      Is64(size) ? absl::StrCat(Bytes(kExtra64), Bytes(uint16_t{16}), Bytes(uint64_t{0}), Bytes(uint64_t{0}))
                 : "";
  const uint32_t unknown = Is64(size) ? kMost32 : 0;
  absl::StrAppend(&bytes, "PK\x03\x04", CommonFields(), Bytes(uint32_t{0}), Bytes(unknown), Bytes(unknown),
                  Bytes(static_cast<uint16_t>(name.size())), Bytes(static_cast<uint16_t>(extra.size())), name,
                  extra);
  written_ += bytes.size();
  return bytes;
}

void ZipWriter::Add(absl::string_view bytes) {
  written_ += bytes.size();
  members_.back().crc =
      static_cast<uint32_t>(crc32_z(members_.back().crc, reinterpret_cast<const Bytef*>(bytes.data()),
                                    static_cast<z_size_t>(bytes.size())));
}

std::string ZipWriter::Descriptor() const {
  if (members_.empty()) return "";
  const Member& last = members_.back();
  const std::string size = Is64(last.size) ? Bytes(last.size) : Bytes(static_cast<uint32_t>(last.size));
  return absl::StrCat("PK\x07\x08", Bytes(last.crc), size, size);
}

std::string ZipWriter::DirectoryEntryOf(const Member& member) {
  std::string large;
  if (Is64(member.size)) large = Bytes(member.size) + Bytes(member.size);
  if (Is64(member.offset)) large += Bytes(member.offset);
  const std::string extra =
      large.empty() ? "" : absl::StrCat(Bytes(kExtra64), Bytes(static_cast<uint16_t>(large.size())), large);
  return absl::StrCat("PK\x01\x02", Bytes(kVersion), CommonFields(), Bytes(member.crc), Bytes32(member.size),
                      Bytes32(member.size), Bytes(static_cast<uint16_t>(member.name.size())),
                      Bytes(static_cast<uint16_t>(extra.size())), std::string(kUnusedBytes, '\0'),
                      Bytes32(member.offset)) +
         member.name + extra;
}

std::string ZipWriter::End() {
  std::string bytes = Descriptor();
  const uint64_t start = written_ + bytes.size();
  for (const Member& member : members_) bytes += DirectoryEntryOf(member);
  const uint64_t count = members_.size();
  const uint64_t size = written_ + bytes.size() - start;
  if (Is64(start) || Is64(size) || count >= kMost16) {
    const uint64_t end = written_ + bytes.size();
    absl::StrAppend(&bytes, "PK\x06\x06", Bytes(uint64_t{44}), Bytes(kVersion), Bytes(kVersion),
                    Bytes(uint32_t{0}), Bytes(uint32_t{0}), Bytes(count), Bytes(count), Bytes(size),
                    Bytes(start));
    absl::StrAppend(&bytes, "PK\x06\x07", Bytes(uint32_t{0}), Bytes(end), Bytes(uint32_t{1}));
  }
  const std::string members = Bytes(count < kMost16 ? static_cast<uint16_t>(count) : kMost16);
  absl::StrAppend(&bytes, "PK\x05\x06", Bytes(uint32_t{0}), members, members, Bytes32(size), Bytes32(start),
                  Bytes(uint16_t{0}));
  written_ += bytes.size();
  return bytes;
}

}  // namespace lumifold::page
