#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/sample_range.h"

namespace lumifold {

/// Edge length in pixels of the blocks of a frame that may have samples of their own: errors gather at edges
/// (docs/decisions/0021-adaptive-sampling.md).
inline constexpr int kSampleBlock = 2;

/// Blocks that `pixels` in a row or column have; the last one may be smaller.
constexpr int BlocksIn(int pixels) { return (pixels + kSampleBlock - 1) / kSampleBlock; }

/// The sample indices of each pixel of a tile: the same in all, or the same within each block of kSampleBlock
/// x kSampleBlock pixels, counted from the tile's corner.
/// Threads: safe concurrently.
class TileSamples {
 public:
  TileSamples(SampleRange all) : blocks_{all} {}  // NOLINT(google-explicit-constructor): the usual case
  /// [first, last) in all.
  TileSamples(uint32_t first, uint32_t last) : TileSamples(SampleRange{first, last}) {}
  /// `blocks`: row by row, BlocksIn(width) x BlocksIn(height) of a tile of this size.
  TileSamples(int width, int height, std::vector<SampleRange> blocks)
      : columns_(static_cast<size_t>(BlocksIn(width))), blocks_(std::move(blocks)) {
    LUMIFOLD_CHECK(blocks_.size() == columns_ * static_cast<size_t>(BlocksIn(height)));
  }

  bool IsUniform() const { return columns_ == 0; }
  /// Of a pixel relative to the tile's corner.
  SampleRange At(int x, int y) const {
    if (IsUniform()) return blocks_[0];
    return blocks_[static_cast<size_t>(y / kSampleBlock) * columns_ + static_cast<size_t>(x / kSampleBlock)];
  }
  /// Row by row; one if IsUniform().
  const std::vector<SampleRange>& blocks() const { return blocks_; }
  /// Samples of all pixels of a tile of this size.
  int64_t CountIn(int width, int height) const;

 private:
  size_t columns_ = 0;  // of blocks; 0: all pixels have the same
  std::vector<SampleRange> blocks_;
};

inline int64_t TileSamples::CountIn(int width, int height) const {
  if (IsUniform()) return int64_t{width} * height * blocks_[0].count();
  int64_t count = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) count += At(x, y).count();
  }
  return count;
}

}  // namespace lumifold
