#pragma once

#include "absl/status/status.h"
#include "filter/image/edged_image.h"
#include "filter/image/rect.h"
#include "filter/image/sample_range.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {

/// Joins the pieces of a delivered unit and checks its layout and values, so that only a unit that can be
/// assembled is committed.
/// Threads: one at a time.
class UnitAssembler {
 public:
  /// `rect` and `samples` are those of the unit's lease.
  UnitAssembler(v1::UnitKind kind, const Rect& rect, SampleRange samples);

  /// Adds the next piece.
  /// Errors: those of rpc::PixelAssembler, CheckUnitLayout, CheckUnitValues and CheckEdges;
  /// kInvalidArgument for an edge set that is not allowed here. After an error the unit is unusable.
  absl::Status Add(const v1::UnitChunk& chunk);

  /// True after the last piece.
  bool IsComplete() const { return !complete_pixels_.channels().empty(); }
  /// The unit, which must be complete. Leaves the assembler empty.
  EdgedImage Take();

 private:
  absl::Status AddEdges(const v1::PixelChunk& piece);
  absl::Status AddPixels(const v1::PixelChunk& piece, const v1::UnitStats& stats);

  v1::UnitKind kind_;
  Rect rect_;
  SampleRange samples_;
  rpc::PixelAssembler pixels_;
  rpc::PixelAssembler edges_;
  LayeredImage complete_pixels_;
  LayeredImage complete_edges_;
};

}  // namespace lumifold::film
