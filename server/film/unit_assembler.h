#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "filter/image/rect.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"
#include "server/film/unit_layout.h"

namespace lumifold::film {

/// The pixels of a delivered unit and its list, in the pieces in which they arrived: the edge set of a
/// geometry unit, the fragments of a pass. A unit without a list has one without pieces.
struct DeliveredPixels {
  rpc::ReceivedPicture pixels;
  rpc::ReceivedPicture edges;
  /// XXH3-64 of all values as float32: those of the list, then those of the pixels, plane by plane.
  uint64_t values_checksum = 0;
};

/// Collects the pieces of a delivered unit and checks its layout and values in place, so that only a unit
/// that can be assembled is committed.
/// Threads: one at a time.
class UnitAssembler {
 public:
  /// `rect` and `samples` are those of the unit's lease, `model` is that of its job.
  UnitAssembler(v1::UnitKind kind, const Rect& rect, TileSamples samples, const UnitModel& model = {});

  /// Adds the next piece; one that is moved in is not copied.
  /// Errors: those of rpc::PixelAssembler, CheckUnitLayout, CheckUnitValues, CheckEdges, CheckFragments and
  /// CheckFragmentCounts; kInvalidArgument for a list that is not allowed here. After an error the unit is
  /// unusable.
  absl::Status Add(v1::UnitChunk chunk);

  /// True after the last piece.
  bool IsComplete() const { return !complete_.pixels.pieces.empty(); }
  /// The unit, which must be complete. Leaves the assembler empty.
  DeliveredPixels Take();

 private:
  absl::Status AddEdges(v1::PixelChunk piece);
  absl::Status AddPixels(v1::PixelChunk piece, const v1::UnitStats& stats);

  v1::UnitKind kind_;
  Rect rect_;
  TileSamples samples_;
  UnitModel model_;
  rpc::PixelAssembler pixels_;
  rpc::PixelAssembler edges_;
  rpc::RunningChecksum values_;
  DeliveredPixels complete_;
};

}  // namespace lumifold::film
