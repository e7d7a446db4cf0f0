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

}  // namespace

uint64_t HeaderChecksum(const RecordPreamble& preamble, std::string_view header) {
  std::string bytes(reinterpret_cast<const char*>(&preamble), offsetof(RecordPreamble, header_checksum));
  bytes.append(header);
  return rpc::Checksum(bytes);
}

uint64_t EncodedUnit::size_bytes() const { return head.size() + BytesOf(payload); }

std::string DigestOf(const RecordPreamble& preamble) {
  return absl::StrCat(absl::Hex(preamble.payload_checksum, absl::kZeroPad16));
}

std::string EncodedUnit::digest() const {
  RecordPreamble preamble;
  std::memcpy(&preamble, head.data(), sizeof(preamble));
  return DigestOf(preamble);
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
  preamble.header_checksum = HeaderChecksum(preamble, header);
  std::string head(reinterpret_cast<const char*>(&preamble), sizeof(preamble));
  head.append(header);
  return {unit, attempt, stats, std::move(head), std::move(payload)};
}

}  // namespace lumifold::film
