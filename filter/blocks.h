#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/film_source.h"
#include "filter/image/planes.h"
#include "filter/image/rect.h"

namespace lumifold::filter {

/// How a large frame is cut into blocks, each filtered as a film of its own. This is part of the method:
/// other numbers give another picture. All but the last are in pixels along one axis.
struct BlockParams {
  int core = 1408;  // most that a block answers for
  int margin = 64;  // what it sees beyond its core: 4 sigma of the widest reach
  int fade = 32;    // on either side of the border between two cores their blocks are cross-faded
  int64_t whole = int64_t{1536} * 1536;  // pixels up to which a frame is one block
};

/// One axis of the lattice of blocks: equal cores, whole bands each, the last one cut by the frame's edge.
class BlockAxis {
 public:
  /// Part [begin, end) of the axis.
  struct Span {
    int begin = 0;
    int end = 0;
  };

  /// An axis of `size` pixels. core >= 2 fade > 0; fade is a power of two, so that weights are exact.
  BlockAxis(int size, const BlockParams& params);

  int count() const { return count_; }
  Span Core(int i) const { return Widened(i, 0); }
  /// The core and `px` pixels on either side, within the frame.
  Span Widened(int i, int px) const;
  /// Block i's share of pixel p: 1 within its core, 0 from `fade` pixels beyond it, linear between. The
  /// shares of all blocks sum to 1, exactly.
  float Share(int i, int p) const;
  /// What this block and all before it take of pixel p together, where this one takes any.
  float ShareSoFar(int i, int p) const;

 private:
  /// How far p is on the way across a border, 0 to 1.
  float Passed(int border, int p) const;

  int size_;
  int core_;
  int count_;
  int fade_;
};

/// The blocks of a frame, by column and row.
class BlockGrid {
 public:
  BlockGrid(int width, int height, const BlockParams& params);

  int columns() const { return columns_.count(); }
  int rows() const { return rows_.count(); }
  bool IsOneBlock() const { return columns() == 1 && rows() == 1; }
  /// What the block answers for alone or most.
  Rect Core(int column, int row) const { return Around(column, row, 0); }
  /// The pixels that take something of its result.
  Rect Given(int column, int row) const { return Around(column, row, params_.fade); }
  /// What is filtered for it.
  Rect Seen(int column, int row) const { return Around(column, row, params_.margin); }
  /// How far block (column, row) draws each pixel of row y in its Given() from the mean of the blocks before
  /// it, from left to right and from the top down, towards its own: then all together make the mean by their
  /// shares, and what all agree on stays as it is to the last bit.
  std::vector<float> Pull(int column, int row, int y) const;

 private:
  Rect Around(int column, int row, int px) const;

  BlockParams params_;
  BlockAxis columns_;
  BlockAxis rows_;
};

/// Filters one block: a film and its edge set.
using BlockFilter = absl::FunctionRef<absl::StatusOr<Picture>(const EdgedImage&)>;

/// Filters a film block by block, from left to right and from the top down, and gives the picture to `sink`,
/// a row of blocks at a time: R G B and the film's channels named in `passed_on`. In memory are one block and
/// what `filter` needs for it, and the rows of the result that a row of blocks touches.
/// Errors: those of the film, `filter` and `sink`; kInvalidArgument for a channel to pass on that is not
/// there.
absl::Status FilterInBlocks(FilmSource* film, const BlockParams& params,
                            const std::vector<std::string>& passed_on, BlockFilter filter,
                            const RowSink& sink);

}  // namespace lumifold::filter
