#include "worker/render/sampling/sobol_lanes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/render/sampling/sobol_lanes.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using FloatTag = hn::CappedTag<float, kMaxLanes>;
using BitsTag = hn::RebindToUnsigned<FloatTag>;

/// 32 bits of each of several samples.
struct Bits {
  hn::Vec<BitsTag> v;

  Bits() = default;
  HWY_INLINE Bits(hn::Vec<BitsTag> vector) : v(vector) {}  // NOLINT(google-explicit-constructor): of results
  HWY_INLINE explicit Bits(uint32_t bits) : v(hn::Set(BitsTag(), bits)) {}
};

HWY_INLINE Bits operator+(Bits a, Bits b) { return hn::Add(a.v, b.v); }
HWY_INLINE Bits operator*(Bits a, Bits b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Bits operator^(Bits a, Bits b) { return hn::Xor(a.v, b.v); }
HWY_INLINE Bits operator&(Bits a, Bits b) { return hn::And(a.v, b.v); }
HWY_INLINE Bits operator|(Bits a, Bits b) { return hn::Or(a.v, b.v); }
HWY_INLINE Bits operator>>(Bits a, int count) { return hn::ShiftRightSame(a.v, count); }

HWY_INLINE Bits ReverseBits(Bits x) {
  const hn::Repartition<uint8_t, BitsTag> bytes;
  alignas(16) static constexpr uint8_t kBytes[16] = {3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12};
  alignas(16) static constexpr uint8_t kHalves[16] = {0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15};
  const auto swapped = hn::TableLookupBytes(hn::BitCast(bytes, x.v), hn::LoadDup128(bytes, kBytes));
  const auto reversed = hn::LoadDup128(bytes, kHalves);  // of four bits
  const auto low = hn::TableLookupBytes(reversed, hn::And(swapped, hn::Set(bytes, 15)));
  const auto high = hn::TableLookupBytes(reversed, hn::ShiftRight<4>(swapped));
  return hn::BitCast(BitsTag(), hn::Or(hn::ShiftLeft<4>(low), high));
}

#include "worker/render/sampling/sobol-inl.h"

HWY_INLINE void StoreUnitFloats(Bits x, float* out) {
  const FloatTag d;
  const auto whole = hn::BitCast(hn::RebindToSigned<FloatTag>(), (x >> 8).v);
  hn::StoreU(hn::Mul(hn::ConvertTo(d, whole), hn::Set(d, 0x1p-24f)), d, out);
}

void DrawPairs(const LaneBits& reversed_index, const LaneBits& shuffle, const LaneBits& scramble,
               size_t count, LanePair* out) {
  const BitsTag d;
  for (size_t first = 0; first < count; first += hn::Lanes(d)) {
    Bits x, y;
    DrawPair(hn::LoadU(d, reversed_index.data() + first), hn::LoadU(d, shuffle.data() + first),
             hn::LoadU(d, scramble.data() + first), &x, &y);
    StoreUnitFloats(x, out->x.data() + first);
    StoreUnitFloats(y, out->y.data() + first);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::render {

HWY_EXPORT(DrawPairs);

void DrawPairs(const LaneBits& reversed_index, const LaneBits& shuffle, const LaneBits& scramble,
               size_t count, LanePair* out) {
  HWY_DYNAMIC_DISPATCH(DrawPairs)(reversed_index, shuffle, scramble, count, out);
}

}  // namespace lumifold::render
#endif
