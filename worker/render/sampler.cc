#include "worker/render/sampler.h"

namespace lumifold::render {
namespace {

constexpr uint32_t ReverseBits(uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

/// Owen's nested uniform scramble of a value whose bits are reversed (lowest first): bit k is flipped by a
/// hash of the bits below.
constexpr uint32_t ScrambleReversed(uint32_t x, uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

/// The second Sobol dimension of index i, bits reversed: the product with Pascal's triangle modulo 2, done by
/// halves.
constexpr uint32_t SobolSecondReversed(uint32_t i) {
  i ^= (i >> 1) & 0x55555555u;
  i ^= (i >> 2) & 0x33333333u;
  i ^= (i >> 4) & 0x0f0f0f0fu;
  i ^= (i >> 8) & 0x00ff00ffu;
  i ^= (i >> 16) & 0x0000ffffu;
  return i;
}

constexpr float UnitFloat(uint32_t x) { return static_cast<float>(x >> 8) * 0x1p-24f; }

}  // namespace

Sampler::Sampler(uint64_t seed, int frame, int64_t pixel, uint32_t index) : index_(index >> 1) {
  const uint64_t half = index & 1u;
  const uint64_t frame_key =
      MixBits(seed + 0x9e3779b97f4a7c15u) ^ (static_cast<uint64_t>(static_cast<uint32_t>(frame)) << 1 | half);
  key_ = MixBits(MixBits(frame_key) + static_cast<uint64_t>(pixel));
}

scene::Vec2 Sampler::Get2D(uint32_t pair) const {
  const uint64_t bits = MixBits(key_ + 0x9e3779b97f4a7c15u * (pair + 1));
  const auto shuffle_seed = static_cast<uint32_t>(bits);
  const auto x_seed = static_cast<uint32_t>(bits >> 32);
  const uint32_t y_seed = x_seed * 0x9e3779b1u + shuffle_seed;
  const uint32_t index = ReverseBits(ScrambleReversed(ReverseBits(index_), shuffle_seed));
  // Sobol's first dimension is the index bit-reversed, so reversed again it is the index itself.
  const uint32_t x = ReverseBits(ScrambleReversed(index, x_seed));
  const uint32_t y = ReverseBits(ScrambleReversed(SobolSecondReversed(index), y_seed));
  return {UnitFloat(x), UnitFloat(y)};
}

}  // namespace lumifold::render
