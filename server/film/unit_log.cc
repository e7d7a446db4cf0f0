#include "server/film/unit_log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {
namespace {

static_assert(std::endian::native == std::endian::little, "the log has the byte order of memory");

constexpr std::array<char, 4> kMagic = {'L', 'F', 'U', '2'};
constexpr uint32_t kMaxHeaderBytes = 1 << 20;
constexpr uint64_t kMaxPayloadBytes = uint64_t{1} << 32;

struct Preamble {
  std::array<char, 4> magic = kMagic;
  uint32_t header_bytes = 0;
  uint64_t payload_bytes = 0;
  uint64_t payload_checksum = 0;
  uint64_t header_checksum = 0;
};
static_assert(sizeof(Preamble) == 32, "no padding");

uint64_t HeaderChecksum(const Preamble& preamble, std::string_view header) {
  std::string bytes(reinterpret_cast<const char*>(&preamble), offsetof(Preamble, header_checksum));
  bytes.append(header);
  return rpc::Checksum(bytes);
}

absl::Status SystemError(const std::string& path) {
  const int error = errno;
  const std::string text = absl::StrCat(path, ": ", std::strerror(error));
  return error == ENOENT ? absl::NotFoundError(text) : absl::UnavailableError(text);
}

absl::Status DamagedRecord(const std::string& path, uint64_t offset, const char* cause) {
  return absl::DataLossError(absl::StrCat(path, ": record at ", offset, ": ", cause));
}

/// Whether this is the beginning of a record of another version, 1 or a later one.
bool IsOfAnotherVersion(const Preamble& preamble) {
  return std::equal(kMagic.begin(), kMagic.end() - 1, preamble.magic.begin()) && preamble.magic != kMagic &&
         preamble.magic.back() >= '1' && preamble.magic.back() <= '9';
}

absl::Status AnotherVersion(const std::string& path, uint64_t offset) {
  return absl::FailedPreconditionError(absl::StrCat(
      path, ": record at ", offset,
      ": was written by another version of Lumifold; finish the job with that version, or submit it again"));
}

absl::Status SyncFolderOf(const std::string& path) {
  const std::string folder = path.substr(0, path.rfind('/'));
  const rpc::FileHandle handle(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (handle.get() < 0 || fsync(handle.get()) != 0) return SystemError(folder);
  return absl::OkStatus();
}

std::string RecordBytes(const StoredUnit& unit) {
  v1::UnitChunk header;
  *header.mutable_unit() = ProtoFromUnit(unit.unit);
  header.set_attempt(unit.attempt.value());
  *header.mutable_pixels()->mutable_layout() = rpc::LayoutOf(unit.image.pixels);
  *header.mutable_stats() = unit.stats;
  std::string payload = rpc::BytesFromImage(unit.image.pixels);
  if (!unit.image.edges.channels().empty()) {
    *header.mutable_edges()->mutable_layout() = rpc::LayoutOf(unit.image.edges);
    payload.append(rpc::BytesFromImage(unit.image.edges));
  }
  const std::string header_bytes = header.SerializeAsString();
  Preamble preamble;
  preamble.header_bytes = static_cast<uint32_t>(header_bytes.size());
  preamble.payload_bytes = payload.size();
  preamble.payload_checksum = rpc::Checksum(payload);
  preamble.header_checksum = HeaderChecksum(preamble, header_bytes);
  std::string record(reinterpret_cast<const char*>(&preamble), sizeof(preamble));
  record.append(header_bytes).append(payload);
  return record;
}

// Decodes the pixels and the edge set from the payload of a record.
absl::StatusOr<EdgedImage> ImageFromPayload(const v1::UnitChunk& header, std::string_view payload) {
  EdgedImage image;
  const uint64_t pixel_bytes = std::min<uint64_t>(rpc::BytesOf(header.pixels().layout()), payload.size());
  absl::StatusOr<LayeredImage> pixels =
      rpc::ImageFromBytes(header.pixels().layout(), payload.substr(0, pixel_bytes), {});
  if (!pixels.ok()) return pixels.status();
  image.pixels = *std::move(pixels);
  const std::string_view rest = payload.substr(pixel_bytes);
  if (!header.has_edges()) {
    if (!rest.empty()) return absl::InvalidArgumentError("bytes past the pixels");
    return image;
  }
  rpc::PixelLimits limits;
  limits.max_height = std::numeric_limits<int>::max();  // one row for each edge pixel
  absl::StatusOr<LayeredImage> edges = rpc::ImageFromBytes(header.edges().layout(), rest, limits);
  if (!edges.ok()) return edges.status();
  image.edges = *std::move(edges);
  return image;
}

/// Reads [offset, offset + size), or up to the end of the file.
absl::StatusOr<std::string> ReadAt(const rpc::FileHandle& file, const std::string& path, uint64_t offset,
                                   uint64_t size) {
  std::string bytes(size, '\0');
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n =
        pread(file.get(), bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return SystemError(path);
    if (n == 0) break;
    done += static_cast<size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

/// Reads the beginning of the record at `offset`.
absl::StatusOr<Preamble> ReadPreamble(const rpc::FileHandle& file, const std::string& path, uint64_t offset) {
  const absl::StatusOr<std::string> bytes = ReadAt(file, path, offset, sizeof(Preamble));
  if (!bytes.ok()) return bytes.status();
  if (bytes->size() != sizeof(Preamble)) return DamagedRecord(path, offset, "is cut short");
  Preamble preamble;
  std::memcpy(&preamble, bytes->data(), sizeof(preamble));
  if (IsOfAnotherVersion(preamble)) return AnotherVersion(path, offset);
  if (preamble.magic != kMagic || preamble.header_bytes > kMaxHeaderBytes ||
      preamble.payload_bytes > kMaxPayloadBytes) {
    return DamagedRecord(path, offset, "has no valid record header");
  }
  return preamble;
}

uint64_t LengthOf(const Preamble& preamble) {
  return sizeof(preamble) + preamble.header_bytes + preamble.payload_bytes;
}

/// Reads the header of the record at `place`; `preamble` is the record's.
absl::StatusOr<v1::UnitChunk> ReadHeaderOf(const rpc::FileHandle& file, const std::string& path,
                                           const RecordPlace& place, const Preamble& preamble) {
  if (LengthOf(preamble) != place.length)
    return DamagedRecord(path, place.offset, "has no valid record header");
  const absl::StatusOr<std::string> bytes =
      ReadAt(file, path, place.offset + sizeof(preamble), preamble.header_bytes);
  if (!bytes.ok()) return bytes.status();
  if (HeaderChecksum(preamble, *bytes) != preamble.header_checksum)
    return DamagedRecord(path, place.offset, "the checksum of the header does not match");
  v1::UnitChunk header;
  if (!header.ParseFromString(*bytes)) return DamagedRecord(path, place.offset, "the header cannot be read");
  return header;
}

}  // namespace

UnitLog::UnitLog(std::string path, rpc::FileHandle file, uint64_t end)
    : path_(std::move(path)), file_(std::move(file)), end_(end) {}

absl::StatusOr<UnitLog> UnitLog::Open(const std::string& path, uint64_t committed_bytes) {
  rpc::FileHandle file(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644));
  if (file.get() < 0) return SystemError(path);
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return SystemError(path);
  if (static_cast<uint64_t>(info.st_size) < committed_bytes) {
    return absl::DataLossError(
        absl::StrCat(path, ": has ", info.st_size, " bytes, the ledger has committed ", committed_bytes));
  }
  if (ftruncate(file.get(), static_cast<off_t>(committed_bytes)) != 0) return SystemError(path);
  if (absl::Status status = SyncFolderOf(path); !status.ok()) return status;
  return UnitLog(path, std::move(file), committed_bytes);
}

absl::StatusOr<RecordPlace> UnitLog::Append(const StoredUnit& unit) {
  const std::string record = RecordBytes(unit);
  size_t done = 0;
  while (done < record.size()) {
    const ssize_t n =
        pwrite(file_.get(), record.data() + done, record.size() - done, static_cast<off_t>(end_ + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return SystemError(path_);
    done += static_cast<size_t>(n);
  }
  const RecordPlace place{end_, record.size()};
  end_ += record.size();
  return place;
}

absl::Status UnitLog::Sync() { return fdatasync(file_.get()) == 0 ? absl::OkStatus() : SystemError(path_); }

UnitLogReader::UnitLogReader(std::string path, rpc::FileHandle file, uint64_t size)
    : path_(std::move(path)), file_(std::move(file)), size_(size) {}

absl::StatusOr<UnitLogReader> UnitLogReader::Open(const std::string& path) {
  rpc::FileHandle file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return SystemError(path);
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return SystemError(path);
  return UnitLogReader(path, std::move(file), static_cast<uint64_t>(info.st_size));
}

absl::Status UnitLogReader::CheckWithinFile(const RecordPlace& place) const {
  if (place.offset <= size_ && place.length <= size_ - place.offset) return absl::OkStatus();
  return DamagedRecord(path_, place.offset, "is not within the file");
}

absl::StatusOr<UnitHeader> UnitLogReader::ReadHeader(const RecordPlace& place) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  const absl::StatusOr<Preamble> preamble = ReadPreamble(file_, path_, place.offset);
  if (!preamble.ok()) return preamble.status();
  absl::StatusOr<v1::UnitChunk> header = ReadHeaderOf(file_, path_, place, *preamble);
  if (!header.ok()) return header.status();
  return UnitHeader{
      job::UnitFromProto(header->unit()),
      {std::move(*header->mutable_pixels()->mutable_layout()), header->edges().layout().height()}};
}

absl::StatusOr<StoredUnit> UnitLogReader::Read(const RecordPlace& place) const {
  if (absl::Status status = CheckWithinFile(place); !status.ok()) return status;
  const absl::StatusOr<Preamble> preamble = ReadPreamble(file_, path_, place.offset);
  if (!preamble.ok()) return preamble.status();
  const absl::StatusOr<v1::UnitChunk> header = ReadHeaderOf(file_, path_, place, *preamble);
  if (!header.ok()) return header.status();
  const absl::StatusOr<std::string> payload =
      ReadAt(file_, path_, place.offset + place.length - preamble->payload_bytes, preamble->payload_bytes);
  if (!payload.ok()) return payload.status();
  if (rpc::Checksum(*payload) != preamble->payload_checksum)
    return DamagedRecord(path_, place.offset, "the checksum of the pixels does not match");
  absl::StatusOr<EdgedImage> image = ImageFromPayload(*header, *payload);
  if (!image.ok()) return DamagedRecord(path_, place.offset, "the pixels do not fit the layout");
  return StoredUnit{job::UnitFromProto(header->unit()), job::Attempt(header->attempt()), header->stats(),
                    *std::move(image)};
}

absl::StatusOr<RecordPlace> UnitLogReader::PlaceAt(uint64_t offset) const {
  const absl::StatusOr<Preamble> preamble = ReadPreamble(file_, path_, offset);
  if (!preamble.ok()) return preamble.status();
  return RecordPlace{offset, LengthOf(*preamble)};
}

absl::StatusOr<uint64_t> UnitLogReader::Scan(
    absl::FunctionRef<void(const StoredUnit&, const RecordPlace&)> visit) const {
  uint64_t valid_bytes = 0;
  while (valid_bytes < size_) {
    const absl::StatusOr<RecordPlace> place = PlaceAt(valid_bytes);
    if (absl::IsDataLoss(place.status())) break;
    if (!place.ok()) return place.status();
    const absl::StatusOr<StoredUnit> unit = Read(*place);
    if (absl::IsDataLoss(unit.status())) break;
    if (!unit.ok()) return unit.status();
    visit(*unit, *place);
    valid_bytes += place->length;
  }
  return valid_bytes;
}

}  // namespace lumifold::film
