#pragma once

#include <string>
#include <utility>

#include "filter/image/check.h"
#include "proto/rpc/checksum.h"
#include "server/film/unit_log.h"
#include "tests/support/random_unit.h"

namespace lumifold {

/// A picture as it arrives from a worker.
inline rpc::ReceivedPicture Received(const LayeredImage& picture) {
  if (picture.channels().empty() || picture.height() == 0) return {};
  rpc::PixelAssembler assembler;
  rpc::PixelChunker chunker(picture);
  v1::PixelChunk chunk;
  while (chunker.Next(&chunk)) LUMIFOLD_CHECK(assembler.Add(chunk).ok());
  return assembler.Take();
}

/// A unit as it arrives from a worker.
inline film::EncodedUnit Encoded(const film::StoredUnit& unit) {
  const EdgedImage& image = unit.image;
  const LayeredImage& list = ListOf(image);
  return film::EncodeUnit(unit.unit, unit.attempt, unit.stats,
                          {Received(image.pixels), Received(list),
                           rpc::Checksum(rpc::BytesFromImage(list) + rpc::BytesFromImage(image.pixels))});
}

/// The bytes of a picture that was received.
inline std::string BytesOf(const rpc::ReceivedPicture& picture) {
  std::string bytes;
  for (const rpc::PixelPiece& piece : picture.pieces) bytes += piece.bytes;
  return bytes;
}

/// The values of a unit, in full precision.
inline std::string UnitBytes(const EdgedImage& unit) {
  return rpc::BytesFromImage(unit.pixels) + rpc::BytesFromImage(ListOf(unit));
}

}  // namespace lumifold
