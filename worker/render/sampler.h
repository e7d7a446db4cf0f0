#pragma once

#include <cstdint>

#include "filter/image/mix_bits.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// One sample's stream of random numbers: an Owen-scrambled Sobol (0,2)-sequence per pair of dimensions, the
/// pairs padded with independent shuffles of the index. Keyed by (seed, frame, pixel, sample index) alone, so
/// that any unit can be rendered anywhere, alike to the last bit. Sample i is point i >> 1 of a sequence of
/// half i & 1: each half is well stratified by itself and knows nothing of the other. Source: Burley 2020,
/// "Practical Hash-based Owen Scrambling"; hash constants: Vegdahl 2021.
class Sampler {
 public:
  /// `pixel` is the pixel's row-major number in the frame; `index` the sample's number in the pixel, from 0.
  Sampler(uint64_t seed, int frame, int64_t pixel, uint32_t index);

  /// Two numbers in [0, 1). Each `pair` is a dimension pair of its own; equal pairs give equal numbers.
  scene::Vec2 Get2D(uint32_t pair) const;

  /// Another number for each `pair` and each sample. Far from random: MixBits makes random bits of it.
  uint64_t Key(uint32_t pair) const { return key_ + ((uint64_t{index_} << 32) | pair); }

 private:
  uint64_t key_;
  uint32_t index_;
};

}  // namespace lumifold::render
