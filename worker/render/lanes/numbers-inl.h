// Included once for each instruction set: by files of kernels alone, after hwy/foreach_target.h.
#if defined(LUMIFOLD_RENDER_LANES_NUMBERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef LUMIFOLD_RENDER_LANES_NUMBERS_INL_H_
#undef LUMIFOLD_RENDER_LANES_NUMBERS_INL_H_
#else
#define LUMIFOLD_RENDER_LANES_NUMBERS_INL_H_
#endif

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// At most sixteen paths side by side.
using LaneTag = hn::CappedTag<float, 16>;
using IntLaneTag = hn::RebindToSigned<LaneTag>;
using Mask = hn::Mask<LaneTag>;

/// A number of each of several paths. Every operation is that of a float: products and sums are never fused,
/// quotients and roots are exact.
struct Num {
  hn::Vec<LaneTag> v;

  Num() = default;
  // NOLINTBEGIN(google-explicit-constructor): formulas are those of floats
  HWY_INLINE Num(hn::Vec<LaneTag> vector) : v(vector) {}
  HWY_INLINE Num(float x) : v(hn::Set(LaneTag(), x)) {}
  // NOLINTEND(google-explicit-constructor)
};

HWY_INLINE Num operator+(Num a, Num b) { return hn::Add(a.v, b.v); }
HWY_INLINE Num operator-(Num a, Num b) { return hn::Sub(a.v, b.v); }
HWY_INLINE Num operator*(Num a, Num b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Num operator/(Num a, Num b) { return hn::Div(a.v, b.v); }
HWY_INLINE Num operator-(Num a) { return hn::Neg(a.v); }
HWY_INLINE Mask operator<(Num a, Num b) { return hn::Lt(a.v, b.v); }
HWY_INLINE Mask operator>(Num a, Num b) { return hn::Gt(a.v, b.v); }
HWY_INLINE Mask operator<=(Num a, Num b) { return hn::Le(a.v, b.v); }
HWY_INLINE Mask operator>=(Num a, Num b) { return hn::Ge(a.v, b.v); }
HWY_INLINE Mask operator!=(Num a, Num b) { return hn::Ne(a.v, b.v); }
HWY_INLINE Mask Not(Mask a) { return hn::Not(a); }
HWY_INLINE Mask And(Mask a, Mask b) { return hn::And(a, b); }
HWY_INLINE Mask Or(Mask a, Mask b) { return hn::Or(a, b); }
HWY_INLINE bool Any(Mask m) { return !hn::AllFalse(LaneTag(), m); }
HWY_INLINE bool All(Mask m) { return hn::AllTrue(LaneTag(), m); }
HWY_INLINE Num Select(Mask m, Num yes, Num no) { return hn::IfThenElse(m, yes.v, no.v); }
/// `yes`, or 0.
HWY_INLINE Num Where(Mask m, Num yes) { return hn::IfThenElseZero(m, yes.v); }
HWY_INLINE Num Sqrt(Num a) { return hn::Sqrt(a.v); }
HWY_INLINE Num Abs(Num a) { return hn::Abs(a.v); }
/// std::max and std::min: of the same order in NaN and zeros.
HWY_INLINE Num Max(Num a, Num b) { return Select(a < b, b, a); }
HWY_INLINE Num Min(Num a, Num b) { return Select(b < a, b, a); }
HWY_INLINE Num CopySign(Num magnitude, Num sign) { return hn::CopySign(magnitude.v, sign.v); }
HWY_INLINE Num Load(const float* row) { return hn::LoadU(LaneTag(), row); }
HWY_INLINE void Store(Num a, float* row) { hn::StoreU(a.v, LaneTag(), row); }

struct Num2 {
  Num x, y;
};

struct Num3 {
  Num x, y, z;
};

HWY_INLINE Num3 operator+(Num3 a, Num3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
HWY_INLINE Num3 operator-(Num3 a, Num3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
HWY_INLINE Num3 operator*(Num3 a, Num3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
HWY_INLINE Num3 operator*(Num3 a, Num s) { return {a.x * s, a.y * s, a.z * s}; }
HWY_INLINE Num3 operator/(Num3 a, Num s) { return {a.x / s, a.y / s, a.z / s}; }
HWY_INLINE Num Dot(Num3 a, Num3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
HWY_INLINE Num3 Cross(Num3 a, Num3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
HWY_INLINE Num Length(Num3 a) { return Sqrt(Dot(a, a)); }
HWY_INLINE Num3 Normalize(Num3 a) { return a * (Num(1.0f) / Length(a)); }
HWY_INLINE Num MaxComponent(Num3 a) {
  return Select(a.x > a.y, Select(a.x > a.z, a.x, a.z), Select(a.y > a.z, a.y, a.z));
}
HWY_INLINE Num Luminance(Num3 c) { return Num(0.2126f) * c.x + Num(0.7152f) * c.y + Num(0.0722f) * c.z; }
HWY_INLINE Num3 Select(Mask m, Num3 yes, Num3 no) {
  return {Select(m, yes.x, no.x), Select(m, yes.y, no.y), Select(m, yes.z, no.z)};
}
HWY_INLINE Num3 Where(Mask m, Num3 yes) { return {Where(m, yes.x), Where(m, yes.y), Where(m, yes.z)}; }

/// Four numbers of each path that lie side by side in a record.
struct Num4 {
  Num x, y, z, w;

  HWY_INLINE Num3 xyz() const { return {x, y, z}; }
};

/// Records of four become vectors of one number each, and back: within every block of four lanes, rows and
/// columns of a square of numbers are exchanged.
HWY_INLINE Num4 Transpose(Num4 a) {
  const LaneTag d;
  const hn::RepartitionToWide<hn::RebindToUnsigned<LaneTag>> pairs;
  const auto lower = [&](Num p, Num q) { return hn::BitCast(pairs, hn::InterleaveLower(d, p.v, q.v)); };
  const auto upper = [&](Num p, Num q) { return hn::BitCast(pairs, hn::InterleaveUpper(d, p.v, q.v)); };
  const auto low = lower(a.x, a.y), low2 = lower(a.z, a.w), high = upper(a.x, a.y), high2 = upper(a.z, a.w);
  return {hn::BitCast(d, hn::InterleaveLower(pairs, low, low2)),
          hn::BitCast(d, hn::InterleaveUpper(pairs, low, low2)),
          hn::BitCast(d, hn::InterleaveLower(pairs, high, high2)),
          hn::BitCast(d, hn::InterleaveUpper(pairs, high, high2))};
}

/// The records of paths kLane, kLane + 4, ...
template <size_t kLane, class D, typename At>
HWY_INLINE hn::Vec<D> LoadBlocks(D d, const At& at) {
  if constexpr (hn::MaxLanes(D()) <= 4) {
    return hn::LoadU(d, at(kLane));
  } else {
    const hn::Half<D> half;
    return hn::Combine(d, LoadBlocks<kLane + hn::MaxLanes(D()) / 2>(half, at), LoadBlocks<kLane>(half, at));
  }
}
template <size_t kLane, class D, typename At>
HWY_INLINE void StoreBlocks(D d, hn::Vec<D> v, const At& at) {
  if constexpr (hn::MaxLanes(D()) <= 4) {
    hn::StoreU(v, d, at(kLane));
  } else {
    const hn::Half<D> half;
    StoreBlocks<kLane>(half, hn::LowerHalf(half, v), at);
    StoreBlocks<kLane + hn::MaxLanes(D()) / 2>(half, hn::UpperHalf(half, v), at);
  }
}

/// Reads and writes the four numbers of each path at the address at(lane).
template <typename At>
HWY_INLINE Num4 LoadFours(const At& at) {
  const LaneTag d;
  return Transpose({LoadBlocks<0>(d, at), LoadBlocks<1>(d, at), LoadBlocks<2>(d, at), LoadBlocks<3>(d, at)});
}
template <typename At>
HWY_INLINE void StoreFours(Num4 a, const At& at) {
  const LaneTag d;
  const Num4 rows = Transpose(a);
  StoreBlocks<0>(d, rows.x.v, at);
  StoreBlocks<1>(d, rows.y.v, at);
  StoreBlocks<2>(d, rows.z.v, at);
  StoreBlocks<3>(d, rows.w.v, at);
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
