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

// Loops that need masks are written with Highway; plain ones the compiler turns into vector code, once for
// each target. Multiplications and additions stay apart everywhere, and sums over x never cross lanes.
HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {

HWY_INLINE void AddTo(float* sum, Float value) {
  const Floats d;
  hn::StoreU(hn::Add(hn::LoadU(d, sum), value), d, sum);
}

/// Cells at c, to be read by pixels of some phases: value + part * slope.
struct CellsAt {
  Float value;
  Float slope;
};
HWY_INLINE CellsAt ReadCells(const float* cells) {
  const Floats d;
  const Float value = hn::LoadU(d, cells);
  return {value, hn::Sub(hn::LoadU(d, cells + 1), value)};
}
HWY_INLINE Float Widen(const CellsAt& cells, float part) {
  return hn::Add(cells.value, hn::Mul(hn::Set(Floats(), part), cells.slope));
}

/// Phases whose pixels are summed before they are added to a cell's sum.
constexpr size_t kPhasesTogether = 4;

/// The sum of n vectors, as pairs.
template <size_t n>
HWY_INLINE Float SumOf(const Float* values) {
  if constexpr (n == 4)
    return hn::Add(hn::Add(values[0], values[1]), hn::Add(values[2], values[3]));
  else if constexpr (n == 2)
    return hn::Add(values[0], values[1]);
  else
    return values[0];
}

/// A vector of cells, from `cell` on, in n phases from `phase` on.
template <size_t n>
struct PixelsOf {
  std::ptrdiff_t At(size_t i) const { return (phase + static_cast<std::ptrdiff_t>(i)) * stride + cell; }
  std::ptrdiff_t stride;  // from one phase to the next
  int phase;
  int cell;
};

/// Whether any of the pixels belongs to the cluster.
template <size_t n>
HWY_INLINE bool HasMembers(const SplitArgs& split, const PixelsOf<n>& pixels) {
  const Floats d;
  bool found = false;
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i)
    found |= !hn::AllFalse(d, hn::Eq(hn::LoadU(d, split.labels + pixels.At(i)), hn::Set(d, split.cluster)));
  return found;
}

template <size_t n>
HWY_INLINE void SplitCluster(const WeighArgs& args, const SplitArgs& split, const PixelsOf<n>& pixels,
                             const Float* weights, const Float* alongs) {
  const Floats d;
  Float near_masses[n], far_masses[n];
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i) {
    const std::ptrdiff_t x = pixels.At(i);
    const auto is_own = hn::Eq(hn::LoadU(d, split.labels + x), hn::Set(d, split.cluster));
    const Float before = hn::LoadU(d, split.members + x);
    const Float fade = hn::Min(hn::Set(d, 1.0f), hn::Mul(hn::Abs(alongs[i]), hn::Set(d, 1.0f / kSeam)));
    const Float member = hn::Mul(before, fade);
    const auto is_far = hn::Ge(alongs[i], hn::Zero(d));
    const Float child = hn::Add(hn::Set(d, 2 * split.cluster), hn::IfThenElseZero(is_far, hn::Set(d, 1.0f)));
    hn::StoreU(hn::IfThenElse(is_own, member, before), d, split.members + x);
    hn::StoreU(hn::IfThenElse(is_own, child, hn::LoadU(d, split.next_labels + x)), d, split.next_labels + x);
    const Float mass = hn::IfThenElseZero(is_own, hn::Mul(member, hn::Sub(hn::Set(d, 1.0f), weights[i])));
    far_masses[i] = hn::IfThenElseZero(is_far, mass);
    near_masses[i] = hn::IfThenZeroElse(is_far, mass);
  }
  for (size_t k = 0; k < args.dimensions; ++k) {
    Float near_sums[n], far_sums[n];
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i) {
      const Float feature = hn::LoadU(d, args.features[k] + pixels.At(i));
      near_sums[i] = hn::Mul(near_masses[i], feature);
      far_sums[i] = hn::Mul(far_masses[i], feature);
    }
    AddTo(split.near_sums[k] + pixels.cell, SumOf<n>(near_sums));
    AddTo(split.far_sums[k] + pixels.cell, SumOf<n>(far_sums));
  }
  AddTo(split.near_sums[args.dimensions] + pixels.cell, SumOf<n>(near_masses));
  AddTo(split.far_sums[args.dimensions] + pixels.cell, SumOf<n>(far_masses));
}

/// The phases are all of one side.
template <size_t n, bool kSplits>
HWY_INLINE void WeighPhases(const Phases& phases, const WeighArgs& args, const SplitArgs* split,
                            const PixelsOf<n>& pixels, Float* weights, Float* alongs) {
  const Floats d;
  const float* eta = args.eta + pixels.cell + phases.Side(pixels.phase);
  const float* part = phases.part.data() + pixels.phase;
  Float squares[n];
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i) squares[i] = alongs[i] = hn::Zero(d);
  for (size_t k = 0; k < args.dimensions; ++k, eta += args.eta_stride) {
    const CellsAt cells = ReadCells(eta);
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i) {
      const Float offset = hn::Sub(hn::LoadU(d, args.features[k] + pixels.At(i)), Widen(cells, part[i]));
      squares[i] = hn::Add(squares[i], hn::Mul(offset, offset));
      if (kSplits) alongs[i] = hn::Add(alongs[i], hn::Mul(hn::Set(d, split->axis[k]), offset));
    }
  }
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i) {
    const auto is_near = hn::Lt(squares[i], hn::Set(d, kFarthest));
    weights[i] = hn::Zero(d);
    if (!hn::AllFalse(d, is_near)) {
      weights[i] = hn::IfThenElseZero(is_near, ExpOfNegative(hn::Neg(squares[i])));
      AddTo(args.total + pixels.At(i), weights[i]);
    }
    hn::StoreU(weights[i], d, args.weight + pixels.At(i));
  }
}

template <size_t n, bool kSplits>
HWY_INLINE bool WeighStrip(const Phases& phases, const WeighArgs& args, const SplitArgs* split) {
  constexpr size_t kOfOneSide = n == 4 ? 2 : 1;
  bool found = false;
  for (int phase = 0; phase < phases.step; phase += static_cast<int>(n)) {
    for (int c = 0; c < args.count; c += static_cast<int>(hn::Lanes(Floats()))) {
      Float weights[n], alongs[n];
#pragma GCC unroll 4
      for (size_t i = 0; i < n; i += kOfOneSide) {
        const PixelsOf<kOfOneSide> of_side = {args.phase_stride, phase + static_cast<int>(i), c};
        WeighPhases<kOfOneSide, kSplits>(phases, args, split, of_side, weights + i, alongs + i);
      }
      const PixelsOf<n> pixels = {args.phase_stride, phase, c};
      if (!kSplits || !HasMembers(*split, pixels)) continue;
      found = true;
      SplitCluster(args, *split, pixels, weights, alongs);
    }
  }
  return found;
}

template <bool kSplits>
HWY_INLINE bool WeighAnyStrip(const Phases& phases, const WeighArgs& args, const SplitArgs* split) {
  if (phases.step >= 4) return WeighStrip<kPhasesTogether, kSplits>(phases, args, split);
  return phases.step == 2 ? WeighStrip<2, kSplits>(phases, args, split)
                          : WeighStrip<1, kSplits>(phases, args, split);
}

HWY_ATTR bool WeighRow(const Phases& phases, const WeighArgs& args, const SplitArgs* split) {
  return split != nullptr ? WeighAnyStrip<true>(phases, args, split)
                          : WeighAnyStrip<false>(phases, args, split);
}

template <size_t n>
HWY_INLINE bool SplatPhases(int step, const SplatArgs& args) {
  const Floats d;
  bool found = false;
  for (int phase = 0; phase < step; phase += static_cast<int>(n)) {
    for (int c = 0; c < args.count; c += static_cast<int>(hn::Lanes(d))) {
      const PixelsOf<n> pixels = {args.phase_stride, phase, c};
      Float masses[n];
      Float any = hn::Zero(d);
#pragma GCC unroll 4
      for (size_t i = 0; i < n; ++i) {
        masses[i] = hn::LoadU(d, args.weight + pixels.At(i));
        any = hn::Or(any, masses[i]);
      }
      if (hn::AllTrue(d, hn::Eq(any, hn::Zero(d)))) continue;  // most pixels are far from most manifolds
      found = true;
#pragma GCC unroll 4
      for (size_t i = 0; i < n; ++i) masses[i] = hn::Mul(hn::LoadU(d, args.mask + pixels.At(i)), masses[i]);
      for (size_t k = 0; k < args.signal_count; ++k) {
        Float sums[n];
#pragma GCC unroll 4
        for (size_t i = 0; i < n; ++i)
          sums[i] = hn::Mul(masses[i], hn::LoadU(d, args.signals[k] + pixels.At(i)));
        AddTo(args.sums[k] + c, SumOf<n>(sums));
      }
      AddTo(args.sums[args.signal_count] + c, SumOf<n>(masses));
    }
  }
  return found;
}

HWY_ATTR bool SplatRow(int step, const SplatArgs& args) {
  if (step >= 4) return SplatPhases<kPhasesTogether>(step, args);
  return step == 2 ? SplatPhases<2>(step, args) : SplatPhases<1>(step, args);
}

/// Rows of cells at a vector of points.
struct ReadAtPoints {
  HWY_INLINE ReadAtPoints(const PointCells& cells, int i)
      : left(hn::LoadU(Ints(), cells.left + i)), part(hn::LoadU(Floats(), cells.part + i)) {}
  HWY_INLINE Float operator()(const float* row) const {
    const Floats d;
    const Float value = hn::GatherIndex(d, row, left);
    return hn::Add(value, hn::Mul(part, hn::Sub(hn::GatherIndex(d, row + 1, left), value)));
  }
  Int left;
  Float part;
};

HWY_ATTR void WeighPoints(const PointCells& cells, const WeighArgs& args, size_t shared, float divisor) {
  const Floats d;
  for (int i = 0; i < cells.count; i += static_cast<int>(hn::Lanes(d))) {
    const ReadAtPoints read(cells, i);
    Float square = hn::Zero(d);
    for (size_t k = 0; k < args.dimensions; ++k) {
      if (k == shared) square = hn::Div(square, hn::Set(d, divisor));
      const Float offset = hn::Sub(hn::LoadU(d, args.features[k] + i), read(args.eta + k * args.eta_stride));
      square = hn::Add(square, hn::Mul(offset, offset));
    }
    if (shared == args.dimensions) square = hn::Div(square, hn::Set(d, divisor));
    const Float weight =
        hn::IfThenElseZero(hn::Lt(square, hn::Set(d, kFarthest)), ExpOfNegative(hn::Neg(square)));
    AddTo(args.total + i, weight);
    hn::StoreU(weight, d, args.weight + i);
  }
}

HWY_ATTR void SliceAtPoints(const PointCells& cells, const SliceArgs& args) {
  const Floats d;
  for (int i = 0; i < cells.count; i += static_cast<int>(hn::Lanes(d))) {
    const ReadAtPoints read(cells, i);
    for (size_t k = 0; k < args.planes; ++k) {
      Float sum = args.adds ? hn::LoadU(d, args.sums[k] + i) : hn::Zero(d);
      const float* psi = args.psi + k * args.psi_stride;
      for (size_t j = 0; j < args.manifolds; ++j, psi += args.planes * args.psi_stride) {
        const Float weight = hn::LoadU(d, args.weights[j] + i);
        if (hn::AllTrue(d, hn::Eq(weight, hn::Zero(d)))) continue;
        sum = hn::Add(sum, hn::Mul(weight, read(psi)));
      }
      hn::StoreU(sum, d, args.sums[k] + i);
    }
  }
}

/// m planes from plane `first` on, at a vector of cells in n phases from `phase` on, all of one side.
template <size_t n, size_t m>
HWY_INLINE void SlicePlanes(const Phases& phases, const SliceArgs& args, size_t first, int phase, int c) {
  const Floats d;
  const std::ptrdiff_t x = phase * args.phase_stride + c;
  const auto pixel = [&](size_t i)
                         HWY_ATTR { return x + static_cast<std::ptrdiff_t>(i) * args.phase_stride; };
  const float* psi = args.psi + first * args.psi_stride + c + phases.Side(phase);
  const float* part = phases.part.data() + phase;
  Float sums[m][n];
#pragma GCC unroll 4
  for (size_t k = 0; k < m; ++k) {
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i)
      sums[k][i] = args.adds ? hn::LoadU(d, args.sums[first + k] + pixel(i)) : hn::Zero(d);
  }
  for (size_t j = 0; j < args.manifolds; ++j, psi += args.planes * args.psi_stride) {
    Float weights[n];
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i) weights[i] = hn::LoadU(d, args.weights[j] + pixel(i));
    const Float any = n > 1 ? hn::Add(weights[0], weights[n - 1]) : weights[0];
    if (hn::AllTrue(d, hn::Eq(any, hn::Zero(d)))) continue;
#pragma GCC unroll 4
    for (size_t k = 0; k < m; ++k) {
      const CellsAt cells = ReadCells(psi + k * args.psi_stride);
#pragma GCC unroll 4
      for (size_t i = 0; i < n; ++i)
        sums[k][i] = hn::Add(sums[k][i], hn::Mul(weights[i], Widen(cells, part[i])));
    }
  }
#pragma GCC unroll 4
  for (size_t k = 0; k < m; ++k) {
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i) hn::StoreU(sums[k][i], d, args.sums[first + k] + pixel(i));
  }
}

/// Columns of cells from those at work to those asked for: planes and phases are more rows side by side than
/// the processor foresees by itself.
constexpr int kAhead = 32;
constexpr int kFloatsPerLine = 16;  // of the cache

/// Asks for the pixels of cell c.
HWY_INLINE void FetchAhead(const Phases& phases, const SliceArgs& args, int c) {
  if (c >= args.count) return;
  for (int phase = 0; phase < phases.step; ++phase) {
    const std::ptrdiff_t x = phase * args.phase_stride + c;
    for (size_t j = 0; j < args.manifolds; ++j) __builtin_prefetch(args.weights[j] + x);
    for (size_t k = 0; k < args.planes; ++k) __builtin_prefetch(args.sums[k] + x, 1);
  }
}

template <size_t n>
HWY_INLINE void SlicePhases(const Phases& phases, const SliceArgs& args) {
  for (int c = 0; c < args.count; c += static_cast<int>(hn::Lanes(Floats()))) {
    if (c % kFloatsPerLine == 0) FetchAhead(phases, args, c + kAhead);
    for (int phase = 0; phase < phases.step; phase += static_cast<int>(n)) {
      size_t k = 0;
      for (; k + 4 <= args.planes; k += 4) SlicePlanes<n, 4>(phases, args, k, phase, c);
      for (; k < args.planes; ++k) SlicePlanes<n, 1>(phases, args, k, phase, c);
    }
  }
}

HWY_ATTR void SliceRow(const Phases& phases, const SliceArgs& args) {
  return phases.step >= 4 ? SlicePhases<2>(phases, args) : SlicePhases<1>(phases, args);
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
HWY_EXPORT(WeighPoints);
HWY_EXPORT(SliceAtPoints);
HWY_EXPORT(BlendCells);
HWY_EXPORT(AddProductRow);
HWY_EXPORT(QuotientRow);
HWY_EXPORT(CorrelateRows);
HWY_EXPORT(StabiliseRow);

Phases::Phases(int cell_step) : step(cell_step) {
  for (int j = 0; j < step; ++j)
    part[static_cast<size_t>(j)] =
        step == 1 ? 0.0f  // a cell of one pixel is read as it is
                  : (static_cast<float>((j + step / 2) % step) + 0.5f) / static_cast<float>(step);
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

bool SplatPoints(const PointCells& cells, const SplatArgs& args) {
  bool found = false;
  for (int i = 0; i < cells.count; ++i) {  // one by one: points of a cell share its sum
    const float mass = args.mask[i] * args.weight[i];
    if (mass == 0) continue;
    found = true;
    for (size_t c = 0; c < args.signal_count; ++c) args.sums[c][cells.own[i]] += mass * args.signals[c][i];
    args.sums[args.signal_count][cells.own[i]] += mass;
  }
  return found;
}

bool WeighRow(const Phases& phases, const WeighArgs& args, const SplitArgs* split) {
  return HWY_DYNAMIC_DISPATCH(WeighRow)(phases, args, split);
}
bool SplatRow(int step, const SplatArgs& args) { return HWY_DYNAMIC_DISPATCH(SplatRow)(step, args); }
void SliceRow(const Phases& phases, const SliceArgs& args) { HWY_DYNAMIC_DISPATCH(SliceRow)(phases, args); }
void WeighPoints(const PointCells& cells, const WeighArgs& args, size_t shared, float divisor) {
  HWY_DYNAMIC_DISPATCH(WeighPoints)(cells, args, shared, divisor);
}
void SliceAtPoints(const PointCells& cells, const SliceArgs& args) {
  HWY_DYNAMIC_DISPATCH(SliceAtPoints)(cells, args);
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
