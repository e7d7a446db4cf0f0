#include "server/film/unit_record.h"

#include <bit>
#include <cstddef>
#include <cstring>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"

namespace lumifold::film {
namespace {

static_assert(std::endian::native == std::endian::little, "the log has the byte order of memory");

uint64_t BytesOf(const std::vector<rpc::PixelPiece>& pieces) {
  uint64_t bytes = 0;
  for (const rpc::PixelPiece& piece : pieces) bytes += piece.bytes.size();
  return bytes;
}

void AppendNumber(uint64_t number, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&number), sizeof(number));
}

/// Appends the fields that say what the values are, and none that are unknown.
void AppendLayout(const v1::PixelLayout& layout, std::string* bytes) {
  AppendNumber(static_cast<uint64_t>(layout.width()), bytes);
  AppendNumber(static_cast<uint64_t>(layout.height()), bytes);
  AppendNumber(static_cast<uint64_t>(layout.channels_size()), bytes);
  for (const std::string& name : layout.channels()) bytes->append(name).push_back('\0');
}

}  // namespace

uint64_t HeaderChecksum(const RecordPreamble& preamble, std::string_view header) {
  std::string bytes(reinterpret_cast<const char*>(&preamble), offsetof(RecordPreamble, header_checksum));
  bytes.append(header);
  return rpc::Checksum(bytes);
}

uint64_t EncodedUnit::size_bytes() const { return head.size() + BytesOf(payload); }

std::string DigestOf(const v1::UnitChunk& header, uint64_t values_checksum) {
  std::string bytes;
  AppendLayout(header.pixels().layout(), &bytes);
  AppendLayout(header.edges().layout(), &bytes);
  AppendNumber(values_checksum, &bytes);
  return absl::StrCat(absl::Hex(rpc::Checksum(bytes), absl::kZeroPad16));
}

EncodedUnit EncodeUnit(const job::UnitRef& unit, job::Attempt attempt, const v1::UnitStats& stats,
                       DeliveredPixels delivered) {
  v1::UnitChunk chunk;
  *chunk.mutable_unit() = ProtoFromUnit(unit);
  chunk.set_attempt(attempt.value());
  *chunk.mutable_pixels()->mutable_layout() = std::move(delivered.pixels.layout);
  *chunk.mutable_stats() = stats;
  std::vector<rpc::PixelPiece> payload = std::move(delivered.pixels.pieces);
  if (!delivered.edges.pieces.empty()) {
    *chunk.mutable_edges()->mutable_layout() = std::move(delivered.edges.layout);
    std::move(delivered.edges.pieces.begin(), delivered.edges.pieces.end(), std::back_inserter(payload));
  }
  const std::string header = chunk.SerializeAsString();
  RecordPreamble preamble;
  preamble.header_bytes = static_cast<uint32_t>(header.size());
  preamble.payload_bytes = BytesOf(payload);
  preamble.payload_checksum = rpc::ChecksumOf(payload);
  preamble.values_checksum = delivered.values_checksum;
  preamble.header_checksum = HeaderChecksum(preamble, header);
  std::string head(reinterpret_cast<const char*>(&preamble), sizeof(preamble));
  head.append(header);
  return {
      unit, attempt, stats, std::move(head), std::move(payload), DigestOf(chunk, preamble.values_checksum)};
}

}  // namespace lumifold::film
