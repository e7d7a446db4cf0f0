#include "worker/render/sampling/sampler.h"

#include <array>

#include "hwy/base.h"

namespace lumifold::render {
namespace {

constexpr uint32_t ReverseBits(uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

using Bits = uint32_t;
#include "worker/render/sampling/sobol-inl.h"

constexpr float UnitFloat(uint32_t x) { return static_cast<float>(x >> 8) * 0x1p-24f; }

/// The key of one half of a pixel.
constexpr uint64_t KeyOf(uint64_t seed, int frame, int64_t pixel, uint32_t half) {
  const uint64_t frame_key =
      MixBits(seed + 0x9e3779b97f4a7c15u) ^ (static_cast<uint64_t>(static_cast<uint32_t>(frame)) << 1 | half);
  return MixBits(MixBits(frame_key) + static_cast<uint64_t>(pixel));
}

}  // namespace

Sampler::Sampler(uint64_t seed, int frame, int64_t pixel, uint32_t index)
    : key_(KeyOf(seed, frame, pixel, index & 1u)), index_(index >> 1), reversed_index_(ReverseBits(index_)) {}

scene::Vec2 Sampler::Draw(uint32_t pair) const {
  const Seeds seeds(key_, pair);
  uint32_t x = 0;
  uint32_t y = 0;
  DrawPair(reversed_index_, seeds.shuffle, seeds.scramble, &x, &y);
  return {UnitFloat(x), UnitFloat(y)};
}

SamplerPacket::SamplerPacket(uint64_t seed, int frame, int64_t pixel, uint32_t first) {
  const std::array<uint64_t, 2> keys = {KeyOf(seed, frame, pixel, 0), KeyOf(seed, frame, pixel, 1)};
  const std::array<Sampler::Seeds, 2> seeds = {Sampler::Seeds(keys[0], 0), Sampler::Seeds(keys[1], 0)};
  LaneBits reversed_index = {}, shuffle = {}, scramble = {};
  for (uint32_t i = 0; i < kSamples; ++i) {
    const uint32_t half = (first + i) & 1u;
    Sampler& sampler = samplers_[i];
    sampler.key_ = keys[half];
    sampler.index_ = (first + i) >> 1;
    sampler.reversed_index_ = ReverseBits(sampler.index_);
    sampler.first_pair_ = &first_pair_;
    sampler.lane_ = i;
    reversed_index[i] = sampler.reversed_index_;
    shuffle[i] = seeds[half].shuffle;
    scramble[i] = seeds[half].scramble;
  }
  DrawPairs(reversed_index, shuffle, scramble, kSamples, &first_pair_);
}

}  // namespace lumifold::render
