#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/film_source.h"
#include "filter/image/planes.h"
#include "filter/image/rect.h"

namespace lumifold::filter {

/// Pixels beyond its core that a block reads: the widest window of any stage of the default method, see
/// Stages() in filter/denoise/denoise.h.
int MethodApron();

/// How a large frame is divided into blocks, each filtered as a film of its own. This is part of the method:
/// other numbers give another picture. All but the last are pixels along one axis.
struct BlockParams {
  int core = 1344;                       // largest core: the cores tile the frame
  int margin = MethodApron();            // pixels beyond its core that a block reads
  int fade = 32;                         // half width of the cross-fade over a border between two cores
  int64_t whole = int64_t{1536} * 1536;  // a frame of up to this many pixels is one block,
  int longest = 4096;                    // unless a side is longer: fits of planes then lose their precision
};

/// One axis of the grid of blocks: cores of equal size, a multiple of kBandRows, the last one cropped by the
/// frame's edge.
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
  /// The blending weight of block i at pixel p: 1 inside its core, 0 from `fade` pixels outside, linear in
  /// between. The weights of all blocks sum to exactly 1.
  float Weight(int i, int p) const;
  /// The sum of the weights of block i and all before it at pixel p, where the weight of block i is above 0.
  float WeightSum(int i, int p) const;

 private:
  /// Position of p in the cross-fade over a border, from 0 to 1.
  float FadeAt(int border, int p) const;

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
  /// The block without overlap.
  Rect Core(int column, int row) const { return Around(column, row, 0); }
  /// The pixels whose weight for this block is above 0.
  Rect Output(int column, int row) const { return Around(column, row, params_.fade); }
  /// The pixels that are filtered for it: its output and the apron.
  Rect Input(int column, int row) const { return Around(column, row, params_.margin); }
  /// The interpolation factor of each pixel of row y in Output(): the result is moved by it from the mean of
  /// the blocks before, in order from left to right and from the top down, towards the value of this block.
  /// After all blocks the result is the weighted mean. Where all blocks agree, no bit changes.
  std::vector<float> BlendFactors(int column, int row, int y) const;

 private:
  Rect Around(int column, int row, int px) const;

  BlockParams params_;
  BlockAxis columns_;
  BlockAxis rows_;
};

/// Filters one block, a film and its edge set, to one picture or several.
using BlockFilter = absl::FunctionRef<absl::StatusOr<std::vector<Picture>>(const EdgedImage&)>;

/// The pictures of a block that was filtered before, of its Output(); nullopt: it was not. Null: none was.
using ReadyBlocks = std::function<absl::StatusOr<std::optional<std::vector<Picture>>>(int column, int row)>;

/// Filters a film block by block, from left to right and from the top down. The pictures go to `sink`, one
/// row of blocks at a time: as the layers named in `pictures`, with the film's channels named in `passed_on`.
/// Memory holds one block, the memory of `filter` for it, and the rows of the result that one row of blocks
/// overlaps. Of blocks that are `ready` nothing is read; then `passed_on` is empty.
/// Errors: those of the film, `filter` and `sink`; kInvalidArgument for a name in `passed_on` that is not a
///         channel.
absl::Status FilterInBlocks(FilmSource* film, const BlockParams& params,
                            const std::vector<std::string>& passed_on,
                            const std::vector<std::string_view>& pictures, BlockFilter filter,
                            const RowSink& sink, const ReadyBlocks& ready = nullptr);

}  // namespace lumifold::filter
