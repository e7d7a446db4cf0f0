#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"
#include "server/film/unit_assembler.h"
#include "server/job/unit.h"

namespace lumifold::film {

/// The beginning of a record of a UnitLog, as it is on the disk.
struct RecordPreamble {
  static constexpr std::array<char, 4> kMagic = {'L', 'F', 'U', '8'};

  std::array<char, 4> magic = kMagic;
  uint32_t header_bytes = 0;
  uint64_t payload_bytes = 0;
  uint64_t payload_checksum = 0;
  uint64_t values_checksum = 0;
  uint64_t header_checksum = 0;
};
static_assert(sizeof(RecordPreamble) == 40, "no padding");

/// The header_checksum of a record with this preamble and header.
uint64_t HeaderChecksum(const RecordPreamble& preamble, std::string_view header);

/// A delivered unit in the form of its record, ready to be written: nothing is left to be encoded. The
/// payload is in the pieces in which it arrived.
struct EncodedUnit {
  job::UnitRef unit;
  job::Attempt attempt;
  v1::UnitStats stats;
  /// Preamble and header of the record.
  std::string head;
  /// Payload of the record.
  std::vector<rpc::PixelPiece> payload;
  /// Equal for equal channels and values, however they are encoded.
  std::string digest;

  /// Bytes of the record.
  uint64_t size_bytes() const;
};

/// EncodedUnit::digest of the record with this header and RecordPreamble::values_checksum.
std::string DigestOf(const v1::UnitChunk& header, uint64_t values_checksum);

/// Encodes a complete unit without copying its pixels.
EncodedUnit EncodeUnit(const job::UnitRef& unit, job::Attempt attempt, const v1::UnitStats& stats,
                       DeliveredPixels delivered);

}  // namespace lumifold::film
