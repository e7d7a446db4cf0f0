#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/film_source.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/film/film_builder.h"
#include "server/film/unit_layout.h"
#include "server/film/unit_source.h"
#include "server/job/frame_rounds.h"
#include "server/job/tile_grid.h"

namespace lumifold::film {

/// The rounds of a frame that its film is made of; only for a job with adaptive sampling.
struct FilmRounds {
  const job::FrameRounds* rounds = nullptr;  // must outlive the film
  int count = 0;                             // the first so many
};

/// The film of a frame, assembled from its units: the passes of each tile are summed in pass order and in
/// double, then divided by the sample counts. Nothing is cached: each Read assembles the tiles that it needs.
/// The channels are those of FilmBuilder, with the levels that any unit of the frame has.
/// Threads: one at a time; the film is identical for any pool and any order in which units arrived.
class UnitFilm final : public FilmSource {
 public:
  /// Reads the outlines of all units. `spec` is normalised; `units` and `pool`, which may be null,
  /// must outlive the film.
  /// Errors: those of `units`.
  static absl::StatusOr<UnitFilm> Open(const v1::JobSpec& spec, int32_t frame, const UnitSource* units,
                                       TaskPool* pool, const FilmRounds& rounds = {});

  /// The film of a frame that is not finished: of the units for which `has` is true. Where a tile has no
  /// pass, the sample counts and all its layers are 0; where it has no geometry unit, its features are.
  static absl::StatusOr<UnitFilm> OpenUnfinished(const v1::JobSpec& spec, int32_t frame,
                                                 const UnitSource* units,
                                                 std::function<bool(const job::UnitKey&)> has,
                                                 TaskPool* pool);

  /// The film of a frame of which some tiles are here alone, those that its reads touch. `levels` are the
  /// frame's. Neither edge_rows() nor CountFragments() are known.
  static UnitFilm OpenPart(const v1::JobSpec& spec, int32_t frame, const UnitSource* units, TaskPool* pool,
                           const LevelSet& levels);

  int width() const override { return width_; }
  int height() const override { return height_; }
  /// An image without pixels that has the film's channels.
  LayeredImage Outline() const;
  /// The levels that any unit of the frame has.
  const LevelSet& levels() const { return levels_; }
  /// Number of rows of the edge set of the whole film.
  int64_t edge_rows() const { return edge_rows_; }
  /// Number of fragments of the whole film. Reads all passes that have any.
  /// Errors: as Read.
  absl::StatusOr<int64_t> CountFragments() const;
  /// The channels of its fragments.
  std::vector<std::string> FragmentChannels() const { return FilmFragmentChannels(model_); }
  /// End of the band of rows that begins at row `y`: the end of its tiles, so that no unit is read twice, or
  /// an earlier row where the band would take more than 512 MiB.
  int BandEnd(int y) const;

  /// Errors: those of the units, CheckUnitLayout, CheckEdges and CheckFragments; that of the first tile where
  /// several fail.
  absl::StatusOr<EdgedImage> Read(const Rect& rect) override;

 private:
  UnitFilm(const v1::JobSpec& spec, int32_t frame, const UnitSource* units, TaskPool* pool,
           const FilmRounds& rounds);
  std::vector<job::UnitKey> UnitsOf(int32_t tile) const;
  absl::Status FindOutline();

  const int width_;
  const int height_;
  const int tile_size_;
  const int32_t frame_;
  const job::FrameUnits tiles_;
  const UnitSource& units_;
  TaskPool* const pool_;
  const FilmRounds rounds_;
  std::function<bool(const job::UnitKey&)> has_;  // of an unfinished frame
  const UnitModel model_;
  LevelSet levels_;
  int64_t edge_rows_ = 0;
  int64_t pass_rows_ = 0;  // of the fragments of all passes
};

}  // namespace lumifold::film
