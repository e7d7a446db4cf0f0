#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "filter/image/film_source.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/film/unit_layout.h"
#include "server/film/unit_source.h"
#include "server/job/tile_grid.h"

namespace lumifold::film {

/// A frame's film as its units make it: the sums of each tile's passes added, in pass order and in double,
/// and divided by the counts. Nothing of it is kept: what is read is made of the units of the tiles there,
/// anew each time. Its channels are FilmBuilder's, with the levels that any unit of the frame carries.
/// Threads: one at a time; what is read is identical for any pool and for any order units arrived in.
class UnitFilm final : public FilmSource {
 public:
  /// Looks through the outlines of all units. `spec` is normalised; `units` and `pool`, which may be null,
  /// must outlive the film. Errors: those of `units`.
  static absl::StatusOr<UnitFilm> Open(const v1::JobSpec& spec, int32_t frame, const UnitSource* units,
                                       TaskPool* pool);

  int width() const override { return width_; }
  int height() const override { return height_; }
  /// A picture of no pixels with the film's channels.
  LayeredImage Outline() const;
  /// Rows of the whole film's edge set.
  int64_t edge_rows() const { return edge_rows_; }
  /// Where to end a part of whole rows from row `y` on: with the tiles there, so that no unit is read twice,
  /// or sooner where such a part takes much memory.
  int BandEnd(int y) const;

  /// Errors: those of the units; kInvalidArgument for a unit that is not what CheckUnitLayout and CheckEdges
  /// ask. It is the error of the first tile that has one.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  UnitFilm(const v1::JobSpec& spec, int32_t frame, const UnitSource* units, TaskPool* pool);
  absl::Status FindOutline();

  const int width_;
  const int height_;
  const int tile_size_;
  const int32_t frame_;
  const scheduler::FrameUnits tiles_;
  const UnitSource& units_;
  TaskPool* const pool_;
  LevelSet levels_;
  int64_t edge_rows_ = 0;
};

}  // namespace lumifold::film
