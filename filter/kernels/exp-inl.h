// Included once for each instruction set: by files of kernels alone, after hwy/foreach_target.h.
#if defined(LUMIFOLD_FILTER_KERNELS_EXP_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef LUMIFOLD_FILTER_KERNELS_EXP_INL_H_
#undef LUMIFOLD_FILTER_KERNELS_EXP_INL_H_
#else
#define LUMIFOLD_FILTER_KERNELS_EXP_INL_H_
#endif

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;
using Ints = hn::RebindToSigned<Floats>;
using Float = hn::Vec<Floats>;
using Int = hn::Vec<Ints>;

/// Exp of portable_math.h for x <= 0, above -87 to the last bit; meaningless below.
HWY_INLINE Float ExpOfNegative(Float x) {
  const Floats d;
  const Ints di;
  const Float rounder = hn::Set(d, 12582912.0f);
  const Float clamped = hn::Max(x, hn::Set(d, -87.0f));
  const Float shifted = hn::Add(hn::Mul(clamped, hn::Set(d, 1.44269504f)), rounder);
  const Float n = hn::Sub(shifted, rounder);
  const Float r = hn::Sub(hn::Sub(clamped, hn::Mul(n, hn::Set(d, 0.693359375f))),
                          hn::Mul(n, hn::Set(d, -2.12194440e-4f)));
  Float p = hn::Set(d, 1.9875691500e-4f);
  p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.3981999507e-3f));
  p = hn::Add(hn::Mul(p, r), hn::Set(d, 8.3334519073e-3f));
  p = hn::Add(hn::Mul(p, r), hn::Set(d, 4.1665795894e-2f));
  p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.6666665459e-1f));
  p = hn::Add(hn::Mul(p, r), hn::Set(d, 5.0000001201e-1f));
  const Float mantissa = hn::Add(hn::Add(hn::Mul(p, hn::Mul(r, r)), r), hn::Set(d, 1.0f));
  const Int exponent = hn::Sub(hn::BitCast(di, shifted), hn::BitCast(di, rounder));
  const Int power = hn::ShiftLeft<23>(hn::Add(exponent, hn::Set(di, 127)));
  return hn::Mul(mantissa, hn::BitCast(d, power));
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::filter
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
