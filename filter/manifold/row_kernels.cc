#include "filter/manifold/row_kernels.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"
#include "filter/manifold/manifold_constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filter/manifold/row_kernels.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

// Loops that need shuffles or masks are written with Highway; plain ones the compiler turns into vector code,
// once for each target. Multiplications and additions stay apart everywhere, and sums over x never cross
// lanes except pair by pair.
HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;
using Ints = hn::RebindToSigned<Floats>;
using Float = hn::Vec<Floats>;
using Int = hn::Vec<Ints>;

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
  at.cell = *left + (x - phase) / widening.step;
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

HWY_INLINE void AddTo(float* sum, Float value) {
  const Floats d;
  hn::StoreU(hn::Add(hn::LoadU(d, sum), value), d, sum);
}

/// Squared distance from the manifold. Sums of squares only grow: once all pixels are too far to have a
/// weight, what is left of them is not added.
HWY_INLINE Float SquareAt(const LanesAt& at, const SplatArgs& args, int x) {
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
HWY_INLINE Float SquareAndPositionAt(const LanesAt& at, const SplatArgs& args, const float* axis, int x,
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

HWY_INLINE void SplatSignals(const SplatArgs& args, Float weight, int x) {
  const Floats d;
  const Float mass = hn::Mul(hn::LoadU(d, args.mask + x), weight);
  for (size_t c = 0; c < args.signal_count; ++c)
    AddTo(args.sums[c] + x, hn::Mul(mass, hn::LoadU(d, args.signals[c] + x)));
  AddTo(args.sums[args.signal_count] + x, mass);
}

/// Whether any of the pixels belongs to the cluster.
HWY_INLINE bool HasMembers(const SplitArgs& split, int x) {
  const Floats d;
  return !hn::AllFalse(d, hn::Eq(hn::LoadU(d, split.labels + x), hn::Set(d, split.cluster)));
}

HWY_INLINE void SplitCluster(const SplatArgs& args, const SplitArgs& split, Float weight, Float along,
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
HWY_INLINE SplatFound SplatStrip(const Widening& widening, const SplatArgs& args, const SplitArgs* split) {
  const Floats d;
  SplatFound found;
  for (int x = 0; x < args.count; x += static_cast<int>(hn::Lanes(d))) {
    const LanesAt at = LanesFrom(widening, x);
    const bool has_members = kSplits && HasMembers(*split, x);
    Float along = hn::Zero(d);
    const Float square =
        has_members ? SquareAndPositionAt(at, args, split->axis, x, &along) : SquareAt(at, args, x);
    const auto is_near = hn::Lt(square, hn::Set(d, kFarthest));
    const Float weight = hn::IfThenElseZero(is_near, ExpOfNegative(hn::Neg(square)));
    hn::StoreU(weight, d, args.weight + x);
    if (!hn::AllFalse(d, is_near)) {
      found.has_weight = true;
      SplatSignals(args, weight, x);
    }
    if (!has_members) continue;
    found.has_members = true;
    SplitCluster(args, *split, weight, along, x);
  }
  return found;
}

HWY_ATTR SplatFound SplatRow(const Widening& widening, const SplatArgs& args, const SplitArgs* split) {
  return split != nullptr ? SplatStrip<true>(widening, args, split)
                          : SplatStrip<false>(widening, args, nullptr);
}

HWY_ATTR void SliceRow(const Widening& widening, const SliceArgs& args) {
  const Floats d;
  for (int x = 0; x < args.count; x += static_cast<int>(hn::Lanes(d))) {
    const LanesAt at = LanesFrom(widening, x);
    const float* psi = args.psi;
    for (size_t i = 0; i < args.manifolds; ++i, psi += args.planes * args.psi_stride) {
      const Float weight = hn::LoadU(d, args.weights[i] + x);
      if (hn::AllTrue(d, hn::Eq(weight, hn::Zero(d)))) continue;  // most pixels are far from most manifolds
      for (size_t c = 0; c < args.planes; ++c)
        AddTo(args.sums[c] + x, hn::Mul(weight, Widen(at, psi + c * args.psi_stride)));
    }
  }
}

HWY_ATTR void AddPairs(int count, float* values) {
  int i = 0;
#if HWY_TARGET != HWY_SCALAR
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (; 2 * (i + lanes) <= count; i += lanes) {
    const Float lower = hn::LoadU(d, values + 2 * i);
    const Float upper = hn::LoadU(d, values + 2 * i + lanes);
    hn::StoreU(hn::Add(hn::ConcatEven(d, upper, lower), hn::ConcatOdd(d, upper, lower)), d, values + i);
  }
#endif
  for (; i < count / 2; ++i) values[i] = values[2 * i] + values[2 * i + 1];
}

HWY_ATTR void BlendCells(const BlendArgs& args) {
  const int begin = std::max(0, args.first);
  const int end = std::min(args.columns, args.first + args.count);
  const float fraction = args.fraction;
  for (size_t i = 0; i < args.planes; ++i) {
    const float* __restrict upper = args.upper[i];
    const float* __restrict lower = args.lower[i];
    float* __restrict out = args.out + i * args.out_stride;
    for (int c = begin; c < end; ++c) out[c - args.first] = upper[c] + fraction * (lower[c] - upper[c]);
    for (int c = args.first; c < begin; ++c) out[c - args.first] = out[begin - args.first];
    for (int c = end; c < args.first + args.count; ++c) out[c - args.first] = out[end - 1 - args.first];
  }
}

HWY_ATTR void AddProductRow(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b, int count,
                            float* HWY_RESTRICT sums) {
  for (int x = 0; x < count; ++x) sums[x] += a[x] * b[x];
}

HWY_ATTR void SumRows(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b, int count,
                      float* HWY_RESTRICT out) {
  for (int x = 0; x < count; ++x) out[x] = a[x] + b[x];
}

HWY_ATTR void QuotientRow(const float* HWY_RESTRICT total, float least, const float* HWY_RESTRICT instead,
                          int count, float* HWY_RESTRICT sums) {
  for (int x = 0; x < count; ++x) {
    const float quotient = sums[x] / total[x];
    sums[x] = total[x] < least ? instead[x] : quotient;
  }
}

HWY_ATTR void PullRow(const float* HWY_RESTRICT weight, const float* HWY_RESTRICT from, int count,
                      float* HWY_RESTRICT to) {
  for (int x = 0; x < count; ++x) to[x] += weight[x] * (from[x] - to[x]);
}

/// One row after the other. Returns nothing that the vector form does not.
HWY_INLINE void RecurseRow(const float* from, const float* weight, int count, float* to) {
  float last = to[0] = from[0];
  for (int x = 1; x < count; ++x) to[x] = last = from[x] + weight[x] * (last - from[x]);
  for (int x = count - 2; x >= 0; --x) to[x] = last = to[x] + weight[x + 1] * (last - to[x]);
}

#if HWY_TARGET != HWY_SCALAR && !HWY_HAVE_SCALABLE
#define LUMIFOLD_RECURSE_TOGETHER 1

using Four = hn::FixedTag<float, 4>;
using FourFloats = hn::Vec<Four>;

/// Four rows of four numbers become four columns, and back.
HWY_INLINE void Transpose(FourFloats* v) {
  const Four d;
  const FourFloats ab_low = hn::InterleaveLower(d, v[0], v[1]);
  const FourFloats ab_high = hn::InterleaveUpper(d, v[0], v[1]);
  const FourFloats cd_low = hn::InterleaveLower(d, v[2], v[3]);
  const FourFloats cd_high = hn::InterleaveUpper(d, v[2], v[3]);
  v[0] = hn::ConcatLowerLower(d, cd_low, ab_low);
  v[1] = hn::ConcatUpperUpper(d, cd_low, ab_low);
  v[2] = hn::ConcatLowerLower(d, cd_high, ab_high);
  v[3] = hn::ConcatUpperUpper(d, cd_high, ab_high);
}

/// Rows in step: a row is a chain of dependent steps, and many together hide each other's latency.
constexpr size_t kFours = 4;
constexpr size_t kRowsTogether = 4 * kFours;

/// Columns x to x + 3 of four rows, as columns.
HWY_INLINE void LoadColumns(const float* const* rows, int x, FourFloats* columns) {
  const Four d;
  for (size_t i = 0; i < 4; ++i) columns[i] = hn::LoadU(d, rows[i] + x);
  Transpose(columns);
}

/// Four columns of kRowsTogether rows, from the left or from the right; `weights_at`: where the link of
/// column x lies.
template <bool kForward>
HWY_INLINE void RecurseColumns(const float* const* from, const float* const* weights, int x, FourFloats* last,
                               float* const* to) {
  const Four d;
  FourFloats values[kFours][4];
  FourFloats links[kFours][4];
  for (size_t g = 0; g < kFours; ++g) {
    LoadColumns(from + 4 * g, x, values[g]);
    LoadColumns(weights + 4 * g, kForward ? x : x + 1, links[g]);
  }
  for (size_t step = 0; step < 4; ++step) {
    const size_t k = kForward ? step : 3 - step;
    for (size_t g = 0; g < kFours; ++g) {
      last[g] = hn::Add(values[g][k], hn::Mul(links[g][k], hn::Sub(last[g], values[g][k])));
      values[g][k] = last[g];
    }
  }
  for (size_t g = 0; g < kFours; ++g) {
    Transpose(values[g]);
    for (size_t i = 0; i < 4; ++i) hn::StoreU(values[g][i], d, to[4 * g + i] + x);
  }
}

/// kRowsTogether rows. Columns 1 to 4 n come four at a time, the others one by one.
HWY_INLINE void RecurseTogether(const float* const* from, const float* const* weights, int count,
                                float* const* to) {
  const Four d;
  const int end = 1 + (count - 1) / 4 * 4;
  HWY_ALIGN float ends[kRowsTogether];
  FourFloats last[kFours];
  for (size_t i = 0; i < kRowsTogether; ++i) ends[i] = to[i][0] = from[i][0];
  for (size_t g = 0; g < kFours; ++g) last[g] = hn::Load(d, ends + 4 * g);
  for (int x = 1; x < end; x += 4) RecurseColumns<true>(from, weights, x, last, to);
  for (size_t i = 0; i < kRowsTogether; ++i) {
    float* row = to[i];
    for (int x = end; x < count; ++x) row[x] = from[i][x] + weights[i][x] * (row[x - 1] - from[i][x]);
    for (int x = count - 2; x >= end - 1; --x) row[x] += weights[i][x + 1] * (row[x + 1] - row[x]);
    ends[i] = row[end - 1];
  }
  for (size_t g = 0; g < kFours; ++g) last[g] = hn::Load(d, ends + 4 * g);
  int x = end - 5;
  for (; x >= 0; x -= 4) RecurseColumns<false>(to, weights, x, last, to);
}
#endif

HWY_ATTR void RecurseRows(const float* const* from, const float* const* weights, size_t rows, int count,
                          float* const* to) {
  size_t row = 0;
#ifdef LUMIFOLD_RECURSE_TOGETHER
  for (; row + kRowsTogether <= rows; row += kRowsTogether)
    RecurseTogether(from + row, weights + row, count, to + row);
#endif
  for (; row < rows; ++row) RecurseRow(from[row], weights[row], count, to[row]);
}
#undef LUMIFOLD_RECURSE_TOGETHER

/// The links at x and after, a vector of them.
HWY_INLINE Float LinksAt(float slope, float stretch, const float* const* here, const float* const* there,
                         size_t planes, int x) {
  const Floats d;
  Float square = hn::Zero(d);
  for (size_t k = 0; k < planes; ++k) {
    const Float difference = hn::Sub(hn::LoadU(d, here[k] + x), hn::LoadU(d, there[k] + x));
    square = hn::Add(square, hn::Mul(difference, difference));
  }
  const Float length = hn::Sqrt(hn::Add(hn::Set(d, 1.0f), hn::Mul(hn::Set(d, stretch), square)));
  const Float exponent = hn::Mul(hn::Set(d, slope), length);
  return hn::IfThenElseZero(hn::Ge(exponent, hn::Set(d, -87.0f)), ExpOfNegative(exponent));
}

HWY_ATTR void LinkRow(float sigma, float stretch, const float* const* here, const float* const* there,
                      size_t planes, int count, float* weight) {
  const Floats d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const float slope = -kSqrt2 / sigma;
  int x = 0;
  for (; x + lanes <= count; x += lanes)
    hn::StoreU(LinksAt(slope, stretch, here, there, planes, x), d, weight + x);
  for (; x < count; ++x) {
    float square = 0;
    for (size_t k = 0; k < planes; ++k) square += (here[k][x] - there[k][x]) * (here[k][x] - there[k][x]);
    weight[x] = Exp(slope * std::sqrt(1.0f + stretch * square));
  }
}

HWY_ATTR void CorrelateRow(const float* taps, int tap_count, const float* HWY_RESTRICT row, int count,
                           float* HWY_RESTRICT out) {
  int j = 0;
  for (; j + 2 < tap_count; j += 3) {  // three at a time: a third of the traffic to and from `out`
    const float t0 = taps[j];
    const float t1 = taps[j + 1];
    const float t2 = taps[j + 2];
    const float* HWY_RESTRICT at = row + j;
    for (int x = 0; x < count; ++x) out[x] += (t0 * at[x] + t1 * at[x + 1]) + t2 * at[x + 2];
  }
  for (; j < tap_count; ++j) {
    const float tap = taps[j];
    const float* HWY_RESTRICT at = row + j;
    for (int x = 0; x < count; ++x) out[x] += tap * at[x];
  }
}

HWY_ATTR void CandidateErrorRow(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b,
                                const float* HWY_RESTRICT filtered_a, const float* HWY_RESTRICT filtered_b,
                                int count, float* HWY_RESTRICT error) {
  for (int x = 0; x < count; ++x) {
    const float ab = filtered_a[x] - b[x];
    const float ba = filtered_b[x] - a[x];
    const float noise = a[x] - b[x];
    const float disagreement = filtered_a[x] - filtered_b[x];
    error[x] += 0.5f * (ab * ab + ba * ba - noise * noise) - 0.25f * disagreement * disagreement;
  }
}

HWY_ATTR void StabiliseRow(const float* HWY_RESTRICT in, float inverse_knee, float shift, int count,
                           float* HWY_RESTRICT out) {
  for (int x = 0; x < count; ++x) out[x] = Asinh(in[x] * inverse_knee) - shift;
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::filter
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::filter {

HWY_EXPORT(SplatRow);
HWY_EXPORT(SliceRow);
HWY_EXPORT(AddPairs);
HWY_EXPORT(BlendCells);
HWY_EXPORT(AddProductRow);
HWY_EXPORT(SumRows);
HWY_EXPORT(QuotientRow);
HWY_EXPORT(PullRow);
HWY_EXPORT(RecurseRows);
HWY_EXPORT(LinkRow);
HWY_EXPORT(CorrelateRow);
HWY_EXPORT(CandidateErrorRow);
HWY_EXPORT(StabiliseRow);

Widening::Widening(int cell_step) : step(cell_step) {
  const int shift = step == 1 ? 1 : step / 2;  // a one-pixel cell is read as it is
  for (size_t x = 0; x < left.size(); ++x) {
    const int position = static_cast<int>(x) + shift;
    left[x] = position / step;
    part[x] = step == 1 ? 0.0f : (static_cast<float>(position % step) + 0.5f) / static_cast<float>(step);
  }
}

SplatFound SplatRow(const Widening& widening, const SplatArgs& args, const SplitArgs* split) {
  return HWY_DYNAMIC_DISPATCH(SplatRow)(widening, args, split);
}
void SliceRow(const Widening& widening, const SliceArgs& args) {
  HWY_DYNAMIC_DISPATCH(SliceRow)(widening, args);
}
void AddPairs(int count, float* values) { HWY_DYNAMIC_DISPATCH(AddPairs)(count, values); }
void BlendCells(const BlendArgs& args) { HWY_DYNAMIC_DISPATCH(BlendCells)(args); }
void AddProductRow(const float* a, const float* b, int count, float* sums) {
  HWY_DYNAMIC_DISPATCH(AddProductRow)(a, b, count, sums);
}
void SumRows(const float* a, const float* b, int count, float* out) {
  HWY_DYNAMIC_DISPATCH(SumRows)(a, b, count, out);
}
void QuotientRow(const float* total, float least, const float* instead, int count, float* sums) {
  HWY_DYNAMIC_DISPATCH(QuotientRow)(total, least, instead, count, sums);
}
void PullRow(const float* weight, const float* from, int count, float* to) {
  HWY_DYNAMIC_DISPATCH(PullRow)(weight, from, count, to);
}
void RecurseRows(const float* const* from, const float* const* weights, size_t rows, int count,
                 float* const* to) {
  HWY_DYNAMIC_DISPATCH(RecurseRows)(from, weights, rows, count, to);
}
void LinkRow(float sigma, float stretch, const float* const* here, const float* const* there, size_t planes,
             int count, float* weight) {
  HWY_DYNAMIC_DISPATCH(LinkRow)(sigma, stretch, here, there, planes, count, weight);
}
void CorrelateRow(const float* taps, int tap_count, const float* row, int count, float* out) {
  HWY_DYNAMIC_DISPATCH(CorrelateRow)(taps, tap_count, row, count, out);
}
void CandidateErrorRow(const float* a, const float* b, const float* filtered_a, const float* filtered_b,
                       int count, float* error) {
  HWY_DYNAMIC_DISPATCH(CandidateErrorRow)(a, b, filtered_a, filtered_b, count, error);
}
void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out) {
  HWY_DYNAMIC_DISPATCH(StabiliseRow)(in, inverse_knee, shift, count, out);
}

}  // namespace lumifold::filter
#endif
