#pragma once

#include <cstdint>
#include <span>

#include "filter/image/mix_bits.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// The first pairs of dimensions of samples that are drawn together, kept apart by sample.
struct DrawnPairs {
  static constexpr uint32_t kPairs = 7;  // the camera's and those of a path's first two surfaces
  static constexpr uint32_t kSamples = 8;

  float x[kPairs][kSamples];
  float y[kPairs][kSamples];
};

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
  scene::Vec2 Get2D(uint32_t pair) const {
    if (pair < DrawnPairs::kPairs && drawn_ != nullptr)
      return {drawn_->x[pair][lane_], drawn_->y[pair][lane_]};
    return Draw(pair);
  }

  /// Another number for each `pair` and each sample. Far from random: MixBits makes random bits of it.
  uint64_t Key(uint32_t pair) const { return key_ + ((uint64_t{index_} << 32) | pair); }

 private:
  friend class SamplerPacket;
  Sampler() = default;

  scene::Vec2 Draw(uint32_t pair) const;

  uint64_t key_ = 0;  // of the pixel's half
  uint32_t index_ = 0;
  uint32_t reversed_index_ = 0;
  const DrawnPairs* drawn_ = nullptr;
  uint32_t lane_ = 0;
};

/// The streams of a few successive samples of a pixel, the same as they are alone. Their first pairs are
/// drawn side by side, at a fraction of the cost.
class SamplerPacket {
 public:
  SamplerPacket(uint64_t seed, int frame, int64_t pixel, uint32_t first);
  SamplerPacket(const SamplerPacket&) = delete;
  SamplerPacket& operator=(const SamplerPacket&) = delete;

  /// Of samples first, first + 1, ..., DrawnPairs::kSamples of them; for as long as this lives.
  std::span<const Sampler> samplers() const { return {samplers_, DrawnPairs::kSamples}; }

 private:
  Sampler samplers_[DrawnPairs::kSamples];
  DrawnPairs drawn_;
};

}  // namespace lumifold::render
