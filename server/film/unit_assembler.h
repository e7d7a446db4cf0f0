#pragma once

#include "absl/status/status.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {

/// Joins the pieces of a delivered unit and checks that the unit has the layout of its kind and tile.
/// Threads: one at a time.
class UnitAssembler {
 public:
  UnitAssembler(v1::UnitKind kind, const Rect& rect);

  /// Adds the next piece.
  /// Errors: those of rpc::PixelAssembler, CheckUnitLayout and CheckEdges; kInvalidArgument for an edge set
  /// that is not allowed here. After an error the unit is unusable.
  absl::Status Add(const v1::UnitChunk& chunk);

  /// True after the last piece.
  bool IsComplete() const { return pixels_.IsComplete(); }
  /// The unit, which must be complete. Leaves the assembler empty.
  EdgedImage Take();

 private:
  absl::Status AddEdges(const v1::PixelChunk& piece);
  absl::Status AddPixels(const v1::PixelChunk& piece);

  v1::UnitKind kind_;
  Rect rect_;
  rpc::PixelAssembler pixels_;
  rpc::PixelAssembler edges_;
  LayeredImage complete_edges_;
};

}  // namespace lumifold::film
