#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "filter/image/rect.h"
#include "filter/image/sample_range.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/unit.h"

namespace lumifold::job {

/// The tiles of a frame, numbered row by row from the top left. Tiles at the right and lower border may be
/// smaller.
class TileGrid {
 public:
  /// All arguments are at least 1.
  TileGrid(int width, int height, int tile_size);

  int count() const { return columns_ * rows_; }
  /// The pixels of a tile in [0, count()).
  Rect RectOf(int tile) const;
  /// The tiles in a spiral of squares around the centre. Both are O(log tiles) and inverses of each other
  /// over [0, count()).
  int RankOf(int tile) const;
  int TileOfRank(int rank) const;
  /// The tiles that have pixels inside `rect`, in ascending order. `rect` lies within the frame and is not
  /// empty.
  std::vector<int32_t> TilesIn(const Rect& rect) const;

 private:
  /// A row or column of tiles, from (x, y) on in steps of (dx, dy).
  struct Side {
    int x;
    int y;
    int dx;
    int dy;
    int length;
  };

  int CentreX() const { return (columns_ - 1) / 2; }
  int CentreY() const { return (rows_ - 1) / 2; }
  /// Number of tiles at most `radius` columns and rows away from the centre.
  int CountWithin(int radius) const;
  /// The tiles exactly `radius` away, clockwise from the upper left.
  std::array<Side, 4> Ring(int radius) const;

  int width_;
  int height_;
  int tile_size_;
  int columns_;
  int rows_;
};

/// Rounds that a frame with adaptive sampling has at most: they double its samples from the fourth on.
inline constexpr int kMaxRounds = 24;

/// The units that a frame may have, numbered in the order in which they are leased: the geometry and pass 0
/// of one tile after another, in the order of TileGrid::RankOf, so that a preview soon shows the whole
/// picture, its middle first; then pass 1 of every tile and so on, so that an unfinished frame has about the
/// same number of samples everywhere. From pass 1 on the tiles are in the plan's order, if it has one: the
/// costliest first, so that no worker waits for a costly tile at the end. With adaptive sampling a frame has
/// some of these units only, and FrameRounds knows which and their samples. A job that needs a plan has one
/// unit, its plan unit, whose tile is the whole frame.
class FrameUnits {
 public:
  /// `spec` is normalised (server/job/job_spec.h).
  explicit FrameUnits(const v1::JobSpec& spec);

  const TileGrid& tiles() const { return tiles_; }
  int pass_count() const { return pass_count_; }
  bool is_adaptive() const { return is_adaptive_; }
  /// Number of units of the frame, or that it may have.
  int64_t count() const { return int64_t{tiles_.count()} * (1 + pass_count_); }

  /// Number of a unit; nullopt where the frame has no such unit. The key's frame is ignored.
  std::optional<int64_t> NumberOf(const UnitKey& key) const;
  /// The inverse of NumberOf, for a number in [0, count()).
  UnitKey KeyOf(int32_t frame, int64_t number) const;

  /// The kind of the unit with a number in [0, count()).
  v1::UnitKind KindOf(int64_t number) const {
    return pass_count_ == 0 || (number < 2 * int64_t{tiles_.count()} && number % 2 == 0) ? first_kind_
                                                                                         : v1::UNIT_KIND_PASS;
  }

  /// Sample indices of a pass; empty for other units, and with adaptive sampling.
  SampleRange SamplesOf(const UnitKey& key) const;
  /// Camera samples of a pass, over all its pixels; 0 for other units.
  int64_t CameraSamplesOf(const UnitKey& key) const;

 private:
  int RankOf(int tile) const;
  int TileOfRank(int rank) const;
  /// Index of the first sample of a pass; samples_per_pixel after the last.
  int FirstSampleOf(int pass) const;

  v1::UnitKind first_kind_;  // of the units before the passes
  TileGrid tiles_;
  std::vector<int32_t> tile_of_rank_;  // the plan's order; empty: that of tiles_
  std::vector<int32_t> rank_of_tile_;  // its inverse
  int samples_per_pixel_;
  int pass_samples_;
  int first_pass_samples_;
  int pass_count_;
  bool is_adaptive_;
};

}  // namespace lumifold::job
