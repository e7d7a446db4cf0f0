#include "server/film/unit_log.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"
#include "server/film/unit_layout.h"
#include "server/job/limits.h"

namespace lumifold::film {
namespace {

constexpr uint32_t kMaxHeaderBytes = 1 << 20;
constexpr uint64_t kMaxPayloadBytes = uint64_t{1} << 32;

absl::Status DamagedRecord(const std::string& path, uint64_t offset, absl::string_view cause) {
  return absl::DataLossError(absl::StrCat(path, ": record at ", offset, ": ", cause));
}

/// Whether this is the beginning of a record of another version, 1 or a later one.
bool IsOfAnotherVersion(const RecordPreamble& preamble) {
  return std::equal(RecordPreamble::kMagic.begin(), RecordPreamble::kMagic.end() - 1,
                    preamble.magic.begin()) &&
         preamble.magic != RecordPreamble::kMagic && preamble.magic.back() >= '1' &&
         preamble.magic.back() <= '9';
}

absl::Status AnotherVersion(const std::string& path, uint64_t offset) {
  return absl::FailedPreconditionError(absl::StrCat(
      path, ": record at ", offset,
      ": was written by another version of Lumifold; finish the job with that version, or submit it again"));
}

/// An error of a write or sync: one of the file alone is told from one of the whole disk.
absl::Status LogWriteError(const std::string& path, int error) {
  absl::Status status = StorageError(path, error);
  return error == -EIO ? absl::DataLossError(status.message()) : status;
}

// Decodes the pixels and the list from the payload of a record.
absl::StatusOr<EdgedImage> ImageFromPayload(const v1::UnitChunk& header, std::string_view payload) {
  constexpr Rect kLargest = {0, 0, job::kMaxTileSize, job::kMaxTileSize};
  EdgedImage image;
  const uint64_t pixel_bytes =
      std::min<uint64_t>(rpc::EncodedBytesOf(header.pixels().layout()), payload.size());
  absl::StatusOr<LayeredImage> pixels =
      rpc::ImageFromBytes(header.pixels().layout(), payload.substr(0, pixel_bytes), UnitLimits(kLargest));
  if (!pixels.ok()) return pixels.status();
  image.pixels = *std::move(pixels);
  const std::string_view rest = payload.substr(pixel_bytes);
  if (!header.has_edges()) {
    if (!rest.empty()) return absl::InvalidArgumentError("pixels: bytes past the last plane");
    return image;
  }
  const v1::UnitKind kind = header.unit().kind();
  absl::StatusOr<LayeredImage> list =
      rpc::ListFromBytes(header.edges().layout(), rest, ListLimits(kind, kLargest));
  if (!list.ok()) return list.status();
  (kind == v1::UNIT_KIND_PASS ? image.fragments : image.edges) = *std::move(list);
  return image;
}

/// Reads [offset, offset + size), or up to the end of the file.
absl::StatusOr<std::string> BytesAt(const rpc::FileHandle& file, const std::string& path, uint64_t offset,
                                    uint64_t size) {
  std::string bytes(size, '\0');
  const int64_t count = ReadAt(file.get(), offset, bytes.data(), bytes.size());
  if (count < 0) return FileError(path, count);
  bytes.resize(static_cast<size_t>(count));
  return bytes;
}

/// Reads the beginning of the record at `offset`.
absl::StatusOr<RecordPreamble> ReadPreamble(const rpc::FileHandle& file, const std::string& path,
                                            uint64_t offset) {
  const absl::StatusOr<std::string> bytes = BytesAt(file, path, offset, sizeof(RecordPreamble));
  if (!bytes.ok()) return bytes.status();
  if (bytes->size() != sizeof(RecordPreamble)) return DamagedRecord(path, offset, "is cut short");
  RecordPreamble preamble;
  std::memcpy(&preamble, bytes->data(), sizeof(preamble));
  if (IsOfAnotherVersion(preamble)) return AnotherVersion(path, offset);
  if (preamble.magic != RecordPreamble::kMagic || preamble.header_bytes > kMaxHeaderBytes ||
      preamble.payload_bytes > kMaxPayloadBytes) {
    return DamagedRecord(path, offset, "has no valid record header");
  }
  return preamble;
}

uint64_t LengthOf(const RecordPreamble& preamble) {
  return sizeof(preamble) + preamble.header_bytes + preamble.payload_bytes;
}

/// Reads the header of the record at `place`; `preamble` is the record's.
absl::StatusOr<v1::UnitChunk> ReadHeaderOf(const rpc::FileHandle& file, const std::string& path,
                                           const RecordPlace& place, const RecordPreamble& preamble) {
  if (LengthOf(preamble) != place.length)
    return DamagedRecord(path, place.offset, "has no valid record header");
  const absl::StatusOr<std::string> bytes =
      BytesAt(file, path, place.offset + sizeof(preamble), preamble.header_bytes);
  if (!bytes.ok()) return bytes.status();
  if (HeaderChecksum(preamble, *bytes) != preamble.header_checksum)
    return DamagedRecord(path, place.offset, "the checksum of the header does not match");
  v1::UnitChunk header;
  if (!header.ParseFromString(*bytes)) return DamagedRecord(path, place.offset, "the header cannot be read");
  return header;
}

}  // namespace

UnitLog::UnitLog(std::string path, rpc::FileHandle file, uint64_t end, FileSystem* files)
    : files_(files), path_(std::move(path)), file_(std::move(file)), end_(end) {}

absl::StatusOr<UnitLog> UnitLog::Open(const std::string& path, uint64_t committed_bytes, FileSystem* files) {
  int opened = files->Open(path, O_WRONLY);
  const bool is_new = opened == -ENOENT;
  if (is_new) opened = files->Open(path, O_WRONLY | O_CREAT);
  if (opened < 0) return StorageError(path, opened);
  rpc::FileHandle file(opened);
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return FileError(path, errno);
  const auto size = static_cast<uint64_t>(info.st_size);
  if (size < committed_bytes) {
    return absl::DataLossError(
        absl::StrCat(path, ": has ", size, " bytes, the ledger has committed ", committed_bytes));
  }
  if (size > committed_bytes) {
    if (const int error = files->Truncate(file.get(), committed_bytes); error != 0)
      return StorageError(path, error);
  }
  // Also where the file is old: the run that created it may have been killed before its name was durable.
  if (const int error = committed_bytes == 0 ? files->SyncFolder(FolderOf(path)) : 0; error != 0)
    return StorageError(path, error);
  return UnitLog(path, std::move(file), committed_bytes, files);
}

absl::StatusOr<RecordPlace> UnitLog::Append(const EncodedUnit& unit) {
  std::vector<std::string_view> parts = {unit.head};
  for (const rpc::PixelPiece& piece : unit.payload) parts.push_back(piece.bytes);
  if (const int error = files_->Write(file_.get(), end_, parts); error != 0)
    return LogWriteError(path_, error);
  const RecordPlace place{end_, unit.size_bytes()};
  end_ += place.length;
  return place;
}

absl::Status UnitLog::Sync() {
  const int error = files_->Sync(file_.get());
  return error == 0 ? absl::OkStatus() : LogWriteError(path_, error);
}

UnitLogReader::UnitLogReader(std::string path, rpc::FileHandle file, uint64_t size)
    : path_(std::move(path)), file_(std::move(file)), size_(size) {}

absl::StatusOr<UnitLogReader> UnitLogReader::Open(const std::string& path) {
  rpc::FileHandle file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return FileError(path, errno);
  return OfFile(std::move(file), path);
}

absl::StatusOr<UnitLogReader> UnitLogReader::OfFile(rpc::FileHandle file, const std::string& path) {
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return FileError(path, errno);
  return UnitLogReader(path, std::move(file), static_cast<uint64_t>(info.st_size));
}

absl::Status UnitLogReader::CheckWithinFile(const RecordPlace& place) const {
  if (place.offset <= size_ && place.length <= size_ - place.offset) return absl::OkStatus();
  return DamagedRecord(path_, place.offset, "is not within the file");
}

absl::StatusOr<UnitHeader> UnitLogReader::ReadHeader(const RecordPlace& place) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  const absl::StatusOr<RecordPreamble> preamble = ReadPreamble(file_, path_, place.offset);
  if (!preamble.ok()) return preamble.status();
  absl::StatusOr<v1::UnitChunk> header = ReadHeaderOf(file_, path_, place, *preamble);
  if (!header.ok()) return header.status();
  return UnitHeader{job::UnitFromProto(header->unit()),
                    {std::move(*header->mutable_pixels()->mutable_layout()),
                     header->edges().layout().height(), std::move(*header->mutable_stats())}};
}

absl::Status UnitLogReader::ReadBytes(const RecordPlace& place, uint64_t first,
                                      absl::Span<char> bytes) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  if (first > place.length || bytes.size() > place.length - first)
    return DamagedRecord(path_, place.offset, "is shorter than what is wanted");
  const int64_t count = ReadAt(file_.get(), place.offset + first, bytes.data(), bytes.size());
  if (count < 0) return FileError(path_, count);
  if (static_cast<size_t>(count) < bytes.size()) return DamagedRecord(path_, place.offset, "is cut short");
  return absl::OkStatus();
}

absl::Status UnitLogReader::ForEachHeader(
    absl::FunctionRef<void(const UnitHeader&, const RecordPlace&)> visit) const {
  for (uint64_t offset = 0; offset < size_;) {
    const absl::StatusOr<RecordPlace> place = PlaceAt(offset);
    if (!place.ok()) return place.status();
    const absl::StatusOr<UnitHeader> header = ReadHeader(*place);
    if (!header.ok()) return header.status();
    visit(*header, *place);
    offset += place->length;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> UnitLogReader::ReadDigest(const RecordPlace& place) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  const absl::StatusOr<RecordPreamble> preamble = ReadPreamble(file_, path_, place.offset);
  if (!preamble.ok()) return preamble.status();
  const absl::StatusOr<v1::UnitChunk> header = ReadHeaderOf(file_, path_, place, *preamble);
  if (!header.ok()) return header.status();
  return DigestOf(*header, preamble->values_checksum);
}

absl::StatusOr<StoredUnit> UnitLogReader::Read(const RecordPlace& place) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  const absl::StatusOr<RecordPreamble> preamble = ReadPreamble(file_, path_, place.offset);
  if (!preamble.ok()) return preamble.status();
  const absl::StatusOr<v1::UnitChunk> header = ReadHeaderOf(file_, path_, place, *preamble);
  if (!header.ok()) return header.status();
  const absl::StatusOr<std::string> payload =
      BytesAt(file_, path_, place.offset + place.length - preamble->payload_bytes, preamble->payload_bytes);
  if (!payload.ok()) return payload.status();
  if (rpc::Checksum(*payload) != preamble->payload_checksum)
    return DamagedRecord(path_, place.offset, "the checksum of the pixels does not match");
  absl::StatusOr<EdgedImage> image = ImageFromPayload(*header, *payload);
  if (!image.ok()) return DamagedRecord(path_, place.offset, image.status().message());
  return StoredUnit{job::UnitFromProto(header->unit()), job::Attempt(header->attempt()), header->stats(),
                    *std::move(image)};
}

absl::StatusOr<RecordPlace> UnitLogReader::PlaceAt(uint64_t offset) const {
  const absl::StatusOr<RecordPreamble> preamble = ReadPreamble(file_, path_, offset);
  if (!preamble.ok()) return preamble.status();
  return RecordPlace{offset, LengthOf(*preamble)};
}

absl::StatusOr<StoredUnit> UnitLogReader::ReadRecordAt(uint64_t offset, RecordPlace* place) const {
  const absl::StatusOr<RecordPlace> found = PlaceAt(offset);
  if (!found.ok()) return found.status();
  *place = *found;
  return Read(*found);
}

absl::StatusOr<uint64_t> UnitLogReader::FindMagic(uint64_t offset) const {
  constexpr uint64_t kStep = 1 << 20;
  const std::string_view magic(RecordPreamble::kMagic.data(), RecordPreamble::kMagic.size());
  for (; offset < size_; offset += kStep) {
    // The windows overlap, so that no record begins unseen at the end of one.
    const absl::StatusOr<std::string> bytes = BytesAt(file_, path_, offset, kStep + magic.size() - 1);
    if (!bytes.ok()) return bytes.status();
    const size_t found = bytes->find(magic);
    if (found != std::string::npos) return offset + found;
  }
  return size_;
}

absl::StatusOr<uint64_t> UnitLogReader::Scan(
    uint64_t first, absl::FunctionRef<void(const StoredUnit&, const RecordPlace&)> visit) const {
  uint64_t end = first;
  for (uint64_t offset = first; offset < size_;) {
    RecordPlace place;
    const absl::StatusOr<StoredUnit> unit = ReadRecordAt(offset, &place);
    if (unit.ok()) {
      visit(*unit, place);
      offset = end = place.offset + place.length;
      continue;
    }
    if (!absl::IsDataLoss(unit.status())) return unit.status();
    const absl::StatusOr<uint64_t> next = FindMagic(offset + 1);
    if (!next.ok()) return next.status();
    offset = *next;
  }
  return end;
}

}  // namespace lumifold::film
