#include "server/film/unit_assembler.h"

#include <utility>

namespace lumifold::film {

UnitAssembler::UnitAssembler(v1::UnitKind kind, const Rect& rect, TileSamples samples, const UnitModel& model)
    : kind_(kind),
      rect_(rect),
      samples_(std::move(samples)),
      model_(model),
      pixels_(UnitLimits(rect)),
      edges_(ListLimits(kind, rect)) {}

absl::Status UnitAssembler::Add(v1::UnitChunk chunk) {
  if (chunk.has_edges() && chunk.has_pixels())
    return absl::InvalidArgumentError("unit: pixels and a list in one piece");
  return chunk.has_edges() ? AddEdges(std::move(*chunk.mutable_edges()))
                           : AddPixels(std::move(*chunk.mutable_pixels()), chunk.stats());
}

absl::Status UnitAssembler::AddEdges(v1::PixelChunk piece) {
  if (pixels_.layout().has_value() || IsComplete() || !complete_.edges.pieces.empty())
    return absl::InvalidArgumentError("unit: a piece of the list after the list or the pixels");
  if (absl::Status status = edges_.Add(std::move(piece)); !status.ok()) return status;
  if (!edges_.IsComplete()) return absl::OkStatus();
  complete_.edges = edges_.Take();
  return kind_ == v1::UNIT_KIND_PASS ? CheckFragments(rect_, model_, complete_.edges, &values_)
                                     : CheckEdges(rect_, complete_.edges, &values_);
}

absl::Status UnitAssembler::AddPixels(v1::PixelChunk piece, const v1::UnitStats& stats) {
  if (IsComplete()) return absl::InvalidArgumentError("unit: pixels after the last piece");
  const bool is_first = !pixels_.layout().has_value();
  if (is_first && edges_.layout().has_value())
    return absl::InvalidArgumentError("unit: pixels before the end of the list");
  if (absl::Status status = pixels_.Add(std::move(piece)); !status.ok()) return status;
  if (is_first) {
    if (absl::Status status = CheckUnitLayout(kind_, rect_, *pixels_.layout(), model_); !status.ok())
      return status;
  }
  if (!pixels_.IsComplete()) return absl::OkStatus();
  complete_.pixels = pixels_.Take();
  absl::Status status = CheckUnitValues(kind_, rect_, samples_, complete_.pixels, stats, &values_);
  complete_.values_checksum = values_.Value();
  if (!status.ok() || kind_ != v1::UNIT_KIND_PASS) return status;
  return CheckFragmentCounts(rect_, complete_.edges, complete_.pixels);
}

DeliveredPixels UnitAssembler::Take() { return std::exchange(complete_, {}); }

}  // namespace lumifold::film
