#include "worker/render/sampling/sampler.h"

#include <array>
#include <cstring>

namespace lumifold::render {
namespace {

constexpr uint32_t ReverseBits(uint32_t x) {
  x = __builtin_bswap32(x);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

/// Owen's nested uniform scramble of a value with reversed bits (lowest first): a hash of the bits below bit
/// k decides whether bit k is flipped.
constexpr uint32_t ScrambleReversed(uint32_t x, uint32_t seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
  return x;
}

/// The second Sobol dimension of index i, bits reversed: the product with Pascal's triangle modulo 2,
/// computed by recursive halving.
constexpr uint32_t SobolSecondReversed(uint32_t i) {
  i ^= (i >> 1) & 0x55555555u;
  i ^= (i >> 2) & 0x33333333u;
  i ^= (i >> 4) & 0x0f0f0f0fu;
  i ^= (i >> 8) & 0x00ff00ffu;
  i ^= (i >> 16) & 0x0000ffffu;
  return i;
}

constexpr float UnitFloat(uint32_t x) { return static_cast<float>(x >> 8) * 0x1p-24f; }

/// The key of one half of a pixel.
constexpr uint64_t KeyOf(uint64_t seed, int frame, int64_t pixel, uint32_t half) {
  const uint64_t frame_key =
      MixBits(seed + 0x9e3779b97f4a7c15u) ^ (static_cast<uint64_t>(static_cast<uint32_t>(frame)) << 1 | half);
  return MixBits(MixBits(frame_key) + static_cast<uint64_t>(pixel));
}

// The same for eight samples at once. Functions work in place, because vectors wider than the machine's
// cannot be passed by value.
constexpr uint32_t kLanes = DrawnPairs::kSamples;
using Lanes [[gnu::vector_size(sizeof(uint32_t) * kLanes)]] = uint32_t;
using SignedLanes [[gnu::vector_size(sizeof(uint32_t) * kLanes)]] = int32_t;
using FloatLanes [[gnu::vector_size(sizeof(uint32_t) * kLanes)]] = float;

[[gnu::always_inline]] inline void ReverseBitsOf(Lanes& x) {
  x = (x << 16) | (x >> 16);
  x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
  x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
  x = ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

[[gnu::always_inline]] inline void ScrambleLanes(const Lanes& seed, Lanes& x) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1u;
  x ^= x * 0x05526c56u;
  x ^= x * 0x53a22864u;
}

[[gnu::always_inline]] inline void SobolSecondOf(Lanes& i) {
  i ^= (i >> 1) & 0x55555555u;
  i ^= (i >> 2) & 0x33333333u;
  i ^= (i >> 4) & 0x0f0f0f0fu;
  i ^= (i >> 8) & 0x00ff00ffu;
  i ^= (i >> 16) & 0x0000ffffu;
}

[[gnu::always_inline]] inline void StoreUnitFloats(const Lanes& x, float* out) {
  const FloatLanes floats =
      __builtin_convertvector(reinterpret_cast<SignedLanes>(x >> 8), FloatLanes) * 0x1p-24f;
  std::memcpy(out, &floats, sizeof(floats));
}

/// Computes the first pairs of samples first, first + 1, ...; `keys` are those of the halves.
[[gnu::always_inline]] inline void DrawPairs(const std::array<uint64_t, 2>& keys, uint32_t first,
                                             DrawnPairs* out) {
  const Lanes number = Lanes{0, 1, 2, 3, 4, 5, 6, 7} + first;
  const Lanes is_odd = reinterpret_cast<Lanes>((number & 1u) != 0);
  Lanes reversed = number >> 1;
  ReverseBitsOf(reversed);
  for (uint32_t pair = 0; pair < DrawnPairs::kPairs; ++pair) {
    const Sampler::Seeds even(keys[0], pair);
    const Sampler::Seeds odd(keys[1], pair);
    const Lanes shuffle_seed = (Lanes{} + even.shuffle) ^ (is_odd & (even.shuffle ^ odd.shuffle));
    const Lanes x_seed = (Lanes{} + even.scramble) ^ (is_odd & (even.scramble ^ odd.scramble));
    const Lanes y_seed = (Lanes{} + even.Second()) ^ (is_odd & (even.Second() ^ odd.Second()));
    Lanes x = reversed;
    ScrambleLanes(shuffle_seed, x);
    ReverseBitsOf(x);
    Lanes y = x;
    ScrambleLanes(x_seed, x);
    ReverseBitsOf(x);
    StoreUnitFloats(x, out->x[pair]);
    SobolSecondOf(y);
    ScrambleLanes(y_seed, y);
    ReverseBitsOf(y);
    StoreUnitFloats(y, out->y[pair]);
  }
}

void DrawPairsNarrow(const std::array<uint64_t, 2>& keys, uint32_t first, DrawnPairs* out) {
  DrawPairs(keys, first, out);
}
#if defined(__x86_64__)
// Integer arithmetic only, so both have the same result.
[[gnu::target("avx2")]] void DrawPairsWide(const std::array<uint64_t, 2>& keys, uint32_t first,
                                           DrawnPairs* out) {
  DrawPairs(keys, first, out);
}

const auto draw_pairs = __builtin_cpu_supports("avx2") ? DrawPairsWide : DrawPairsNarrow;
#else
const auto draw_pairs = DrawPairsNarrow;
#endif

}  // namespace

Sampler::Sampler(uint64_t seed, int frame, int64_t pixel, uint32_t index)
    : key_(KeyOf(seed, frame, pixel, index & 1u)), index_(index >> 1), reversed_index_(ReverseBits(index_)) {}

scene::Vec2 Sampler::Draw(uint32_t pair) const {
  const Seeds seeds(key_, pair);
  const uint32_t index = ReverseBits(ScrambleReversed(reversed_index_, seeds.shuffle));
  // Sobol's first dimension is the bit-reversed index; reversed again it is the index itself.
  const uint32_t x = ReverseBits(ScrambleReversed(index, seeds.scramble));
  const uint32_t y = ReverseBits(ScrambleReversed(SobolSecondReversed(index), seeds.Second()));
  return {UnitFloat(x), UnitFloat(y)};
}

SamplerPacket::SamplerPacket(uint64_t seed, int frame, int64_t pixel, uint32_t first) {
  const std::array<uint64_t, 2> keys = {KeyOf(seed, frame, pixel, 0), KeyOf(seed, frame, pixel, 1)};
  draw_pairs(keys, first, &drawn_);
  for (uint32_t i = 0; i < DrawnPairs::kSamples; ++i) {
    Sampler& sampler = samplers_[i];
    sampler.key_ = keys[(first + i) & 1u];
    sampler.index_ = (first + i) >> 1;
    sampler.reversed_index_ = ReverseBits(sampler.index_);
    sampler.drawn_ = &drawn_;
    sampler.lane_ = i;
  }
}

}  // namespace lumifold::render
