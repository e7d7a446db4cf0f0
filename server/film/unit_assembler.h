#pragma once

#include "absl/status/status.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {

/// Puts a delivered unit together from its pieces, and sees that it is what a unit of its kind and tile must
/// be. Threads: one at a time.
class UnitAssembler {
 public:
  UnitAssembler(v1::UnitKind kind, const Rect& rect);

  /// Takes the next piece. Errors: those of rpc::PixelAssembler, CheckUnitLayout and CheckEdges;
  /// kInvalidArgument for pieces of an edge set that has no business here. After an error the unit is lost.
  absl::Status Add(const v1::UnitChunk& chunk);

  /// True once the last piece has been taken.
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
  LayeredImage whole_edges_;
};

}  // namespace lumifold::film
