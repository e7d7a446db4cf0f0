#pragma once

#include <cstdint>
#include <span>

#include "filter/image/mix_bits.h"
#include "worker/render/sampling/sobol_lanes.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// The random numbers of one sample: an Owen-scrambled Sobol (0,2)-sequence for each pair of dimensions;
/// pairs are decorrelated by independent shuffles of the index (padding). The key is (seed, frame, pixel,
/// sample index) alone, so that a unit has the same bits wherever it is rendered. Sample i is point i >> 1 of
/// the sequence of half i & 1: each half is well stratified and independent of the other.
/// Source: Burley 2020, "Practical Hash-based Owen Scrambling"; hash constants: Vegdahl 2021.
class Sampler {
 public:
  /// `pixel` is the pixel's row-major number in the frame; `index` the sample's number in the pixel, from 0.
  Sampler(uint64_t seed, int frame, int64_t pixel, uint32_t index);

  /// Two numbers in [0, 1): the sample's coordinates in dimension pair `pair`.
  scene::Vec2 Get2D(uint32_t pair) const {
    return pair == 0 && first_pair_ != nullptr ? first_pair_->At(lane_) : Draw(pair);
  }

  /// What Get2D() computes a pair from, together with the sample's index in its half, bits reversed.
  struct Seeds {
    uint32_t shuffle;
    uint32_t scramble;  // of the first coordinate

    Seeds(uint64_t key, uint32_t pair) {
      const uint64_t bits = MixBits(key + 0x9e3779b97f4a7c15u * (pair + 1));
      shuffle = static_cast<uint32_t>(bits);
      scramble = static_cast<uint32_t>(bits >> 32);
    }
  };
  Seeds SeedsOf(uint32_t pair) const { return Seeds(key_, pair); }
  uint32_t reversed_index() const { return reversed_index_; }

  /// Random key: a number unique to the pair and the sample. Its bits are not random until hashed by MixBits.
  uint64_t Key(uint32_t pair) const { return key_ + ((uint64_t{index_} << 32) | pair); }

 private:
  friend class SamplerPacket;
  Sampler() = default;

  scene::Vec2 Draw(uint32_t pair) const;

  uint64_t key_ = 0;  // of the pixel's half
  uint32_t index_ = 0;
  uint32_t reversed_index_ = 0;
  const LanePair* first_pair_ = nullptr;  // of the samples of a packet
  uint32_t lane_ = 0;
};

/// The samplers of consecutive samples of a pixel, with the same numbers as separate Samplers. Their first
/// dimension pair, the camera's, is computed together, at a fraction of the cost; paths draw theirs with
/// those of other paths.
class SamplerPacket {
 public:
  static constexpr uint32_t kSamples = 8;

  SamplerPacket(uint64_t seed, int frame, int64_t pixel, uint32_t first);
  SamplerPacket(const SamplerPacket&) = delete;
  SamplerPacket& operator=(const SamplerPacket&) = delete;

  /// The samplers of samples first, ..., first + kSamples - 1; valid while this object exists.
  std::span<const Sampler> samplers() const { return {samplers_, kSamples}; }

 private:
  Sampler samplers_[kSamples];
  LanePair first_pair_;
};

}  // namespace lumifold::render
