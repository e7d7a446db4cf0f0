#include "filter/kernels/row_kernels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filter/kernels/row_kernels.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#include "filter/kernels/exp-inl.h"

// Loops that need shuffles or masks are written with Highway; plain ones the compiler turns into vector code,
// once for each target. Multiplications and additions stay apart everywhere, and sums over x never cross
// lanes except pair by pair.
HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {

/// Where the lanes of a vector of pixels lie between cells.
struct LanesAt {
  int cell;
  Int left;
  Int right;
  Float part;
};

HWY_INLINE LanesAt LanesFrom(const Widening& widening, int x) {
  const Floats d;
  const Ints di;
  const int phase = x % 64;
  const int32_t* left = widening.left.data() + phase;
  LanesAt at;
  at.cell = *left + ((x - phase) >> widening.shift);
  at.left = hn::Sub(hn::LoadU(di, left), hn::Set(di, *left));
  // With one-pixel cells the last right neighbour is out of reach; its part is 0 there.
  at.right = hn::Min(hn::Add(at.left, hn::Set(di, 1)),
                     hn::Set(di, static_cast<int32_t>(std::max<size_t>(hn::Lanes(d), 2)) - 1));
  at.part = hn::LoadU(d, widening.part.data() + phase);
  return at;
}

/// Reads a row of cells at those pixels.
HWY_INLINE Float Widen(const LanesAt& at, const float* cells) {
  const Floats d;
#if HWY_TARGET == HWY_SCALAR
  const Float left = hn::LoadU(d, cells + at.cell);
  const Float right = hn::LoadU(d, cells + at.cell + 1);
#else
  const Float here = hn::LoadU(d, cells + at.cell);
  const Float left = hn::TableLookupLanes(here, hn::IndicesFromVec(d, at.left));
  const Float right = hn::TableLookupLanes(here, hn::IndicesFromVec(d, at.right));
#endif
  return hn::Add(left, hn::Mul(at.part, hn::Sub(right, left)));
}

HWY_INLINE void AddTo(float* sum, Float value) {
  const Floats d;
  hn::StoreU(hn::Add(hn::LoadU(d, sum), value), d, sum);
}

/// Squared distance from the manifold. Sums of squares only grow: once all pixels are too far to have a
/// weight, what is left of them is not added.
HWY_INLINE Float SquareAt(const LanesAt& at, const WeighArgs& args, int x) {
  const Floats d;
  const Float farthest = hn::Set(d, kFarthest);
  Float square = hn::Zero(d);
  for (size_t k = 0; k < args.dimensions; ++k) {
    const Float eta = Widen(at, args.eta + k * args.eta_stride);
    const Float offset = hn::Sub(hn::LoadU(d, args.features[k] + x), eta);
    square = hn::Add(square, hn::Mul(offset, offset));
    if ((k & 1) != 0 && hn::AllTrue(d, hn::Ge(square, farthest))) break;
  }
  return square;
}

/// The same to the end, and position along the axis that splits the manifold's cluster.
HWY_INLINE Float SquareAndPositionAt(const LanesAt& at, const WeighArgs& args, const float* axis, int x,
                                     Float* along) {
  const Floats d;
  Float square = hn::Zero(d);
  *along = hn::Zero(d);
  for (size_t k = 0; k < args.dimensions; ++k) {
    const Float eta = Widen(at, args.eta + k * args.eta_stride);
    const Float offset = hn::Sub(hn::LoadU(d, args.features[k] + x), eta);
    square = hn::Add(square, hn::Mul(offset, offset));
    *along = hn::Add(*along, hn::Mul(hn::Set(d, axis[k]), offset));
  }
  return square;
}

/// Whether any of the pixels belongs to the cluster.
HWY_INLINE bool HasMembers(const SplitArgs& split, int x) {
  const Floats d;
  return !hn::AllFalse(d, hn::Eq(hn::LoadU(d, split.labels + x), hn::Set(d, split.cluster)));
}

HWY_INLINE void SplitCluster(const WeighArgs& args, const SplitArgs& split, Float weight, Float along,
                             int x) {
  const Floats d;
  const auto is_own = hn::Eq(hn::LoadU(d, split.labels + x), hn::Set(d, split.cluster));
  const Float before = hn::LoadU(d, split.members + x);
  const Float fade = hn::Min(hn::Set(d, 1.0f), hn::Mul(hn::Abs(along), hn::Set(d, 1.0f / kSeam)));
  const Float member = hn::Mul(before, fade);
  const auto is_far = hn::Ge(along, hn::Zero(d));
  const Float child = hn::Add(hn::Set(d, 2 * split.cluster), hn::IfThenElseZero(is_far, hn::Set(d, 1.0f)));
  hn::StoreU(hn::IfThenElse(is_own, member, before), d, split.members + x);
  hn::StoreU(hn::IfThenElse(is_own, child, hn::LoadU(d, split.next_labels + x)), d, split.next_labels + x);
  const Float mass = hn::IfThenElseZero(is_own, hn::Mul(member, hn::Sub(hn::Set(d, 1.0f), weight)));
  const Float far_mass = hn::IfThenElseZero(is_far, mass);
  const Float near_mass = hn::IfThenZeroElse(is_far, mass);
  for (size_t k = 0; k < args.dimensions; ++k) {
    const Float feature = hn::LoadU(d, args.features[k] + x);
    AddTo(split.near_sums[k] + x, hn::Mul(near_mass, feature));
    AddTo(split.far_sums[k] + x, hn::Mul(far_mass, feature));
  }
  AddTo(split.near_sums[args.dimensions] + x, near_mass);
  AddTo(split.far_sums[args.dimensions] + x, far_mass);
}

template <bool kSplits>
HWY_INLINE bool WeighStrip(const Widening& widening, const WeighArgs& args, const SplitArgs* split) {
  const Floats d;
  bool found = false;
  for (int x = 0; x < args.count; x += static_cast<int>(hn::Lanes(d))) {
    const LanesAt at = LanesFrom(widening, x);
    const bool has_members = kSplits && HasMembers(*split, x);
    Float along = hn::Zero(d);
    const Float square =
        has_members ? SquareAndPositionAt(at, args, split->axis, x, &along) : SquareAt(at, args, x);
    const auto is_near = hn::Lt(square, hn::Set(d, kFarthest));
    Float weight = hn::Zero(d);
    if (!hn::AllFalse(d, is_near)) {
      weight = hn::IfThenElseZero(is_near, ExpOfNegative(hn::Neg(square)));
      AddTo(args.total + x, weight);
    }
    hn::StoreU(weight, d, args.weight + x);
    if (!has_members) continue;
    found = true;
    SplitCluster(args, *split, weight, along, x);
  }
  return found;
}

HWY_ATTR bool WeighRow(const Widening& widening, const WeighArgs& args, const SplitArgs* split) {
  return split != nullptr ? WeighStrip<true>(widening, args, split)
                          : WeighStrip<false>(widening, args, nullptr);
}

HWY_ATTR bool SplatRow(const SplatArgs& args) {
  const Floats d;
  bool found = false;
  for (int x = 0; x < args.count; x += static_cast<int>(hn::Lanes(d))) {
    const Float weight = hn::LoadU(d, args.weight + x);
    if (hn::AllTrue(d, hn::Eq(weight, hn::Zero(d)))) continue;  // most pixels are far from most manifolds
    found = true;
    const Float mass = hn::Mul(hn::LoadU(d, args.mask + x), weight);
    for (size_t c = 0; c < args.signal_count; ++c)
      AddTo(args.sums[c] + x, hn::Mul(mass, hn::LoadU(d, args.signals[c] + x)));
    AddTo(args.sums[args.signal_count] + x, mass);
  }
  return found;
}

/// `n` planes from plane `first` on, at the pixels of one vector.
template <size_t n>
HWY_INLINE void SlicePlanes(const LanesAt& at, const SliceArgs& args, size_t first, int x) {
  const Floats d;
  const float* psi = args.psi + first * args.psi_stride;
  Float sums[n];
#pragma GCC unroll 4
  for (size_t c = 0; c < n; ++c) sums[c] = hn::LoadU(d, args.sums[first + c] + x);
  for (size_t i = 0; i < args.manifolds; ++i, psi += args.planes * args.psi_stride) {
    const Float weight = hn::LoadU(d, args.weights[i] + x);
    if (hn::AllTrue(d, hn::Eq(weight, hn::Zero(d)))) continue;  // most pixels are far from most manifolds
#pragma GCC unroll 4
    for (size_t c = 0; c < n; ++c)
      sums[c] = hn::Add(sums[c], hn::Mul(weight, Widen(at, psi + c * args.psi_stride)));
  }
#pragma GCC unroll 4
  for (size_t c = 0; c < n; ++c) hn::StoreU(sums[c], d, args.sums[first + c] + x);
}

HWY_ATTR void SliceRow(const Widening& widening, const SliceArgs& args) {
  for (int x = 0; x < args.count; x += static_cast<int>(hn::Lanes(Floats()))) {
    const LanesAt at = LanesFrom(widening, x);
    size_t c = 0;
    for (; c + 4 <= args.planes; c += 4) SlicePlanes<4>(at, args, c, x);
    for (; c < args.planes; ++c) SlicePlanes<1>(at, args, c, x);
  }
}

HWY_ATTR void AddPairs(const float* from, int count, float scale, float* to) {
  int i = 0;
#if HWY_TARGET != HWY_SCALAR
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (; 2 * (i + lanes) <= count; i += lanes) {
    const Float lower = hn::LoadU(d, from + 2 * i);
    const Float upper = hn::LoadU(d, from + 2 * i + lanes);
    const Float sum = hn::Add(hn::ConcatEven(d, upper, lower), hn::ConcatOdd(d, upper, lower));
    hn::StoreU(hn::Mul(hn::Set(d, scale), sum), d, to + i);
  }
#endif
  for (; i < count / 2; ++i) to[i] = scale * (from[2 * i] + from[2 * i + 1]);
}

HWY_INLINE void BlendRow(const float* upper, const float* lower, float fraction, int begin, int end,
                         float* out) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto blend = [&](int c) HWY_ATTR {
    const Float from = hn::LoadU(d, upper + c);
    hn::StoreU(hn::Add(from, hn::Mul(hn::Set(d, fraction), hn::Sub(hn::LoadU(d, lower + c), from))), d,
               out + c - begin);
  };
  int c = begin;
  for (; c + lanes <= end; c += lanes) blend(c);
  if (c < end && begin + lanes <= end) return blend(end - lanes);  // recomputes some cells
  for (; c < end; ++c) out[c - begin] = upper[c] + fraction * (lower[c] - upper[c]);
}

HWY_ATTR void BlendCells(const BlendArgs& args) {
  const int begin = std::max(0, args.first);
  const int end = std::min(args.columns, args.first + args.count);
  for (size_t i = 0; i < args.planes; ++i) {
    float* out = args.out + i * args.out_stride;
    BlendRow(args.upper[i], args.lower[i], args.fraction, begin, end, out + begin - args.first);
    for (int c = args.first; c < begin; ++c) out[c - args.first] = out[begin - args.first];
    for (int c = end; c < args.first + args.count; ++c) out[c - args.first] = out[end - 1 - args.first];
  }
}

HWY_ATTR void AddProductRow(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b, int count,
                            float* HWY_RESTRICT sums) {
  for (int x = 0; x < count; ++x) sums[x] += a[x] * b[x];
}

HWY_ATTR void QuotientRow(const float* total, float least, const float* instead, int count, float* sums) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  int x = 0;
  for (; x + lanes <= count; x += lanes) {
    const Float by = hn::LoadU(d, total + x);
    const Float quotient = hn::Div(hn::LoadU(d, sums + x), by);
    const auto is_little = hn::Lt(by, hn::Set(d, least));
    if (hn::AllFalse(d, is_little))  // nearly everywhere: what to take instead need not be read
      hn::StoreU(quotient, d, sums + x);
    else
      hn::StoreU(hn::IfThenElse(is_little, hn::LoadU(d, instead + x), quotient), d, sums + x);
  }
  for (; x < count; ++x) sums[x] = total[x] < least ? instead[x] : sums[x] / total[x];
}

/// CorrelateRows at n vectors of pixels from x on: sums stay in registers.
template <int n>
HWY_INLINE void CorrelateVectors(const CorrelateArgs& args, int x, float* out) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  Float sums[n];
  for (Float& sum : sums) sum = hn::Zero(d);
  const float* taps = args.taps;
  for (size_t r = 0; r < args.rows; ++r, taps += args.row_taps) {
    const float* row = args.pixels[r] + x;
    const auto product = [&](int j, int i) HWY_ATTR {
      return hn::Mul(hn::Set(d, taps[j]), hn::LoadU(d, row + j + i * lanes));
    };
    int j = 0;
    for (; j + 2 < args.row_taps; j += 3) {
#pragma GCC unroll 4
      for (int i = 0; i < n; ++i)
        sums[i] = hn::Add(sums[i], hn::Add(hn::Add(product(j, i), product(j + 1, i)), product(j + 2, i)));
    }
    for (; j < args.row_taps; ++j) {
#pragma GCC unroll 4
      for (int i = 0; i < n; ++i) sums[i] = hn::Add(sums[i], product(j, i));
    }
  }
  for (int i = 0; i < n; ++i) hn::StoreU(sums[i], d, out + x + i * lanes);
}

HWY_ATTR void CorrelateRows(const CorrelateArgs& args, float* out) {
  constexpr int kTogether = 4;
  const int lanes = static_cast<int>(hn::Lanes(Floats()));
  if (args.count < lanes) return CorrelateNarrowRows(args, out);
  int x = 0;
  for (; x + kTogether * lanes <= args.count; x += kTogether * lanes)
    CorrelateVectors<kTogether>(args, x, out);
  for (; x + lanes <= args.count; x += lanes) CorrelateVectors<1>(args, x, out);
  if (x < args.count) CorrelateVectors<1>(args, args.count - lanes, out);  // recomputes some
}

/// Asinh of portable_math.h to the last bit.
HWY_INLINE Float AsinhOf(Float x) {
  const Floats d;
  const Ints di;
  const auto set = [&](float value) HWY_ATTR { return hn::Set(d, value); };
  const Float magnitude = hn::Min(hn::Abs(x), set(1e18f));
  const Float m2 = hn::Mul(magnitude, magnitude);
  const Float t = hn::Add(magnitude, hn::Sqrt(hn::Add(set(1.0f), m2)));
  const Int bits = hn::BitCast(di, t);
  const Int exponent = hn::ShiftRight<23>(hn::Sub(bits, hn::Set(di, 0x3f3504f3)));
  const Float f = hn::Sub(hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<23>(exponent))), set(1.0f));
  const Float e = hn::ConvertTo(d, exponent);
  Float p = set(7.0376836292e-2f);
  for (const float c : {-1.1514610310e-1f, 1.1676998740e-1f, -1.2420140846e-1f, 1.4249322787e-1f,
                        -1.6668057665e-1f, 2.0000714765e-1f, -2.4999993993e-1f, 3.3333331174e-1f})
    p = hn::Add(hn::Mul(p, f), set(c));
  const Float square = hn::Mul(f, f);
  const Float small = hn::Add(hn::Mul(hn::Mul(p, f), square), hn::Mul(e, set(-2.12194440e-4f)));
  const Float sum = hn::Add(f, hn::Sub(small, hn::Mul(set(0.5f), square)));
  const Float logarithm = hn::Add(sum, hn::Mul(e, set(0.693359375f)));
  Float series = set(15.0f / 336.0f);
  for (const float c : {3.0f / 40.0f, 1.0f / 6.0f, 1.0f}) series = hn::Sub(set(c), hn::Mul(m2, series));
  series = hn::Mul(magnitude, series);
  return hn::CopySign(hn::IfThenElse(hn::Lt(magnitude, set(0.125f)), series, logarithm), x);
}

HWY_ATTR void StabiliseRow(const float* HWY_RESTRICT in, float inverse_knee, float shift, int count,
                           float* HWY_RESTRICT out) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto stabilise = [&](int x) HWY_ATTR {
    const Float value = AsinhOf(hn::Mul(hn::LoadU(d, in + x), hn::Set(d, inverse_knee)));
    hn::StoreU(hn::Sub(value, hn::Set(d, shift)), d, out + x);
  };
  int x = 0;
  for (; x + lanes <= count; x += lanes) stabilise(x);
  if (x < count && lanes <= count) return stabilise(count - lanes);  // recomputes some
  for (; x < count; ++x) out[x] = Asinh(in[x] * inverse_knee) - shift;
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::filter
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::filter {

HWY_EXPORT(WeighRow);
HWY_EXPORT(SplatRow);
HWY_EXPORT(SliceRow);
HWY_EXPORT(AddPairs);
HWY_EXPORT(BlendCells);
HWY_EXPORT(AddProductRow);
HWY_EXPORT(QuotientRow);
HWY_EXPORT(CorrelateRows);
HWY_EXPORT(StabiliseRow);

Widening::Widening(int cell_step)
    : step(cell_step), shift(std::countr_zero(static_cast<unsigned>(cell_step))) {
  const int offset = step == 1 ? 1 : step / 2;  // a one-pixel cell is read as it is
  for (size_t x = 0; x < left.size(); ++x) {
    const int position = static_cast<int>(x) + offset;
    left[x] = position / step;
    part[x] = step == 1 ? 0.0f : (static_cast<float>(position % step) + 0.5f) / static_cast<float>(step);
  }
}

void CorrelateNarrowRows(const CorrelateArgs& args, float* out) {
  for (int x = 0; x < args.count; ++x) {
    const float* taps = args.taps;
    out[x] = 0;
    for (size_t r = 0; r < args.rows; ++r, taps += args.row_taps) {
      const float* row = args.pixels[r] + x;
      int j = 0;
      for (; j + 2 < args.row_taps; j += 3)
        out[x] += (taps[j] * row[j] + taps[j + 1] * row[j + 1]) + taps[j + 2] * row[j + 2];
      for (; j < args.row_taps; ++j) out[x] += taps[j] * row[j];
    }
  }
}

bool WeighRow(const Widening& widening, const WeighArgs& args, const SplitArgs* split) {
  return HWY_DYNAMIC_DISPATCH(WeighRow)(widening, args, split);
}
bool SplatRow(const SplatArgs& args) { return HWY_DYNAMIC_DISPATCH(SplatRow)(args); }
void SliceRow(const Widening& widening, const SliceArgs& args) {
  HWY_DYNAMIC_DISPATCH(SliceRow)(widening, args);
}
void AddPairs(const float* from, int count, float scale, float* to) {
  HWY_DYNAMIC_DISPATCH(AddPairs)(from, count, scale, to);
}
void BlendCells(const BlendArgs& args) { HWY_DYNAMIC_DISPATCH(BlendCells)(args); }
void AddProductRow(const float* a, const float* b, int count, float* sums) {
  HWY_DYNAMIC_DISPATCH(AddProductRow)(a, b, count, sums);
}
void QuotientRow(const float* total, float least, const float* instead, int count, float* sums) {
  HWY_DYNAMIC_DISPATCH(QuotientRow)(total, least, instead, count, sums);
}
void CorrelateRows(const CorrelateArgs& args, float* out) { HWY_DYNAMIC_DISPATCH(CorrelateRows)(args, out); }
void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out) {
  HWY_DYNAMIC_DISPATCH(StabiliseRow)(in, inverse_knee, shift, count, out);
}

}  // namespace lumifold::filter
#endif
