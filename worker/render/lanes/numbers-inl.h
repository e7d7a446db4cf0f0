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
  HWY_INLINE Num(hn::Vec<LaneTag> vector) : v(vector) {}
  HWY_INLINE Num(float x) : v(hn::Set(LaneTag(), x)) {}
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

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
