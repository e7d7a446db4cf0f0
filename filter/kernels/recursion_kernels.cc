#include "filter/kernels/recursion_kernels.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filter/kernels/recursion_kernels.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#include "filter/kernels/exp-inl.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {

/// The link of each x of one row with x - 1.
struct RowLink {
  const float* weights;
  float At(int x) const { return weights[x]; }
};
struct EvenLink {
  float weight;
  float At(int) const { return weight; }
};

/// What is left of a row from column `first` on, when all before is done, and back to `first` - 1.
template <class Link>
HWY_INLINE void RecurseEnd(const float* from, Link link, int first, int count, float* to) {
  for (int x = first; x < count; ++x) to[x] = from[x] + link.At(x) * (to[x - 1] - from[x]);
  for (int x = count - 2; x >= first - 1; --x) to[x] += link.At(x + 1) * (to[x + 1] - to[x]);
}

template <class Link>
HWY_INLINE void RecurseRow(const float* from, Link link, int count, float* to) {
  to[0] = from[0];
  RecurseEnd(from, link, 1, count, to);
}

#if HWY_TARGET != HWY_SCALAR && !HWY_HAVE_SCALABLE
#define LUMIFOLD_RECURSE_TOGETHER 1

/// As many rows run in step as a vector has lanes; each is a chain of dependent steps, and kGroups vectors of
/// them hide each other's latency.
constexpr size_t kLanes = hn::MaxLanes(Floats());
constexpr size_t kGroups = 4;
constexpr int kFloatsPerLine = 16;  // of the cache

/// Four floats of every fourth row, from the first to the last that fills the vector.
template <class D>
HWY_INLINE hn::Vec<D> LoadFours(D d, const float* const* rows, int x) {
  if constexpr (hn::MaxLanes(d) == 4) {
    return hn::LoadU(d, rows[0] + x);
  } else {
    const hn::Half<D> half;
    return hn::Combine(d, LoadFours(half, rows + hn::MaxLanes(half), x), LoadFours(half, rows, x));
  }
}
template <class D>
HWY_INLINE void StoreFours(hn::Vec<D> values, D d, float* const* rows, int x) {
  if constexpr (hn::MaxLanes(d) == 4) {
    hn::StoreU(values, d, rows[0] + x);
  } else {
    const hn::Half<D> half;
    StoreFours(hn::LowerHalf(half, values), half, rows, x);
    StoreFours(hn::UpperHalf(half, values), half, rows + hn::MaxLanes(half), x);
  }
}

/// Four vectors of fours of rows become four columns of kLanes rows, and back.
HWY_INLINE void Transpose(Float* v) {
  const Floats d;
  const hn::Repartition<uint64_t, Floats> pairs;
  const auto ab_low = hn::BitCast(pairs, hn::InterleaveLower(d, v[0], v[1]));
  const auto ab_high = hn::BitCast(pairs, hn::InterleaveUpper(d, v[0], v[1]));
  const auto cd_low = hn::BitCast(pairs, hn::InterleaveLower(d, v[2], v[3]));
  const auto cd_high = hn::BitCast(pairs, hn::InterleaveUpper(d, v[2], v[3]));
  v[0] = hn::BitCast(d, hn::InterleaveLower(pairs, ab_low, cd_low));
  v[1] = hn::BitCast(d, hn::InterleaveUpper(pairs, ab_low, cd_low));
  v[2] = hn::BitCast(d, hn::InterleaveLower(pairs, ab_high, cd_high));
  v[3] = hn::BitCast(d, hn::InterleaveUpper(pairs, ab_high, cd_high));
}

/// Columns x to x + 3 of kLanes rows, as columns.
HWY_INLINE void LoadColumns(const float* const* rows, int x, Float* columns) {
  for (size_t i = 0; i < 4; ++i) columns[i] = LoadFours(Floats(), rows + i, x);
  Transpose(columns);
}

/// The links of kLanes rows, four columns of them at a time.
class RowLinks {
 public:
  explicit RowLinks(const float* const* rows) : rows_(rows) {}
  HWY_INLINE void Load(int x) { LoadColumns(rows_, x, columns_); }
  HWY_INLINE Float Column(size_t k) const { return columns_[k]; }
  RowLink Row(size_t i) const { return {rows_[i]}; }

 private:
  const float* const* rows_;
  Float columns_[4];
};
class EvenLinks {
 public:
  explicit EvenLinks(float weight) : weight_(weight) {}
  HWY_INLINE void Load(int) {}
  HWY_INLINE Float Column(size_t) const { return hn::Set(Floats(), weight_); }
  EvenLink Row(size_t) const { return {weight_}; }

 private:
  float weight_;
};

/// kLanes rows each of some groups, `stride` rows from one group to the next.
struct Groups {
  const float* const* from;
  float* const* to;
  size_t stride;
};

/// Four columns of n groups, from the left or from the right. `last`: of each group the column before.
template <bool kForward, size_t n, class Links>
HWY_INLINE void RecurseColumns(const float* const* from, size_t stride, Links* links, int x, Float* last,
                               float* const* to) {
  Float values[n][4];
#pragma GCC unroll 4
  for (size_t g = 0; g < n; ++g) LoadColumns(from + g * stride, x, values[g]);
  links->Load(kForward ? x : x + 1);
#pragma GCC unroll 4
  for (size_t step = 0; step < 4; ++step) {
    const size_t k = kForward ? step : 3 - step;
    const Float link = links->Column(k);
#pragma GCC unroll 4
    for (size_t g = 0; g < n; ++g) {
      last[g] = hn::Add(values[g][k], hn::Mul(link, hn::Sub(last[g], values[g][k])));
      values[g][k] = last[g];
    }
  }
#pragma GCC unroll 4
  for (size_t g = 0; g < n; ++g) {
    Transpose(values[g]);
#pragma GCC unroll 4
    for (size_t i = 0; i < 4; ++i) StoreFours(values[g][i], Floats(), to + g * stride + i, x);
  }
}

/// Column x of n groups, as vectors.
template <size_t n>
HWY_INLINE void LoadColumn(float* const* rows, size_t stride, int x, Float* column) {
  HWY_ALIGN float values[kLanes];
  for (size_t g = 0; g < n; ++g) {
    for (size_t i = 0; i < kLanes; ++i) values[i] = rows[g * stride + i][x];
    column[g] = hn::Load(Floats(), values);
  }
}

/// Columns from the one at work to those asked for: so many rows side by side are more than the processor
/// foresees by itself.
constexpr int kAhead = 32;

/// Asks for column x of n groups.
template <size_t n>
HWY_INLINE void FetchAhead(const Groups& groups, int x) {
  for (size_t g = 0; g < n; ++g) {
    for (size_t i = g * groups.stride; i < g * groups.stride + kLanes; ++i) {
      __builtin_prefetch(groups.from[i] + x);
      if (groups.from[i] != groups.to[i]) __builtin_prefetch(groups.to[i] + x, 1);
    }
  }
}

/// n groups. Columns 1 to 4 m come four at a time, the others one by one.
template <size_t n, class Links>
HWY_INLINE void RecurseTogether(const Groups& groups, Links links, int count) {
  const int end = 1 + (count - 1) / 4 * 4;
  const size_t stride = groups.stride;
  Float last[n];
  for (size_t g = 0; g < n; ++g) {
    for (size_t i = g * stride; i < g * stride + kLanes; ++i) groups.to[i][0] = groups.from[i][0];
  }
  LoadColumn<n>(groups.to, stride, 0, last);
  for (int x = 1; x < end; x += 4) {
    if (x % kFloatsPerLine == 1 && x + kAhead < count) FetchAhead<n>(groups, x + kAhead);
    RecurseColumns<true, n>(groups.from, stride, &links, x, last, groups.to);
  }
  for (size_t g = 0; g < n; ++g) {
    for (size_t i = 0; i < kLanes; ++i)
      RecurseEnd(groups.from[g * stride + i], links.Row(i), end, count, groups.to[g * stride + i]);
  }
  LoadColumn<n>(groups.to, stride, end - 1, last);
  for (int x = end - 5; x >= 0; x -= 4)
    RecurseColumns<false, n>(groups.to, stride, &links, x, last, groups.to);
}
#endif

HWY_ATTR void RecurseRows(const RecurseArgs& args, const float* const* weights) {
  size_t row = 0;
#ifdef LUMIFOLD_RECURSE_TOGETHER
  for (; row + kLanes <= args.rows; row += kLanes) {
    const RowLinks links(weights + row);
    size_t signal = 0;
    for (; signal + kGroups <= args.signals; signal += kGroups) {
      const size_t first = signal * args.rows + row;
      RecurseTogether<kGroups>({args.from + first, args.to + first, args.rows}, links, args.count);
    }
    for (; signal < args.signals; ++signal) {
      const size_t first = signal * args.rows + row;
      RecurseTogether<1>({args.from + first, args.to + first, args.rows}, links, args.count);
    }
  }
#endif
  for (; row < args.rows; ++row) {
    for (size_t i = row; i < args.signals * args.rows; i += args.rows)
      RecurseRow(args.from[i], RowLink{weights[row]}, args.count, args.to[i]);
  }
}

HWY_ATTR void RecurseRowsEvenly(const RecurseArgs& args, float weight) {
  const size_t rows = args.signals * args.rows;
  size_t row = 0;
#ifdef LUMIFOLD_RECURSE_TOGETHER
  const EvenLinks links(weight);
  for (; row + kGroups * kLanes <= rows; row += kGroups * kLanes)
    RecurseTogether<kGroups>({args.from + row, args.to + row, kLanes}, links, args.count);
  for (; row + kLanes <= rows; row += kLanes)
    RecurseTogether<1>({args.from + row, args.to + row, kLanes}, links, args.count);
#endif
  for (; row < rows; ++row) RecurseRow(args.from[row], EvenLink{weight}, args.count, args.to[row]);
}
#undef LUMIFOLD_RECURSE_TOGETHER

HWY_ATTR void PullRow(const float* HWY_RESTRICT weight, const float* HWY_RESTRICT from, int count,
                      float* HWY_RESTRICT to) {
  for (int x = 0; x < count; ++x) to[x] += weight[x] * (from[x] - to[x]);
}

HWY_ATTR void PullRowEvenly(float weight, const float* HWY_RESTRICT from, int count, float* HWY_RESTRICT to) {
  for (int x = 0; x < count; ++x) to[x] += weight * (from[x] - to[x]);
}

/// The links at x and after, a vector of them.
HWY_INLINE void LinksAt(const LinkArgs& args, const LinkReach& reach, int x, float* weights) {
  const Floats d;
  Float square = hn::Zero(d);
  for (size_t k = 0; k < args.planes; ++k) {
    const Float difference = hn::Sub(hn::LoadU(d, args.here[k] + x), hn::LoadU(d, args.there[k] + x));
    square = hn::Add(square, hn::Mul(difference, difference));
  }
  const Float length = hn::Sqrt(hn::Add(hn::Set(d, 1.0f), hn::Mul(hn::Set(d, reach.stretch), square)));
  const Float exponent = hn::Mul(hn::Set(d, -kSqrt2 / reach.sigma), length);
  hn::StoreU(hn::IfThenElseZero(hn::Ge(exponent, hn::Set(d, -87.0f)), ExpOfNegative(exponent)), d,
             weights + x);
}

HWY_ATTR void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights) {
  const int lanes = static_cast<int>(hn::Lanes(Floats()));
  if (args.count < lanes) return LinkNarrowRow(args, reach, weights);
  for (int x = 0; x + lanes <= args.count; x += lanes) LinksAt(args, reach, x, weights);
  if (args.count % lanes != 0) LinksAt(args, reach, args.count - lanes, weights);
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::filter
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::filter {

HWY_EXPORT(RecurseRows);
HWY_EXPORT(RecurseRowsEvenly);
HWY_EXPORT(PullRow);
HWY_EXPORT(PullRowEvenly);
HWY_EXPORT(LinkRow);

void LinkNarrowRow(const LinkArgs& args, const LinkReach& reach, float* weights) {
  for (int x = 0; x < args.count; ++x) {
    float square = 0;
    for (size_t k = 0; k < args.planes; ++k) {
      const float difference = args.here[k][x] - args.there[k][x];
      square += difference * difference;
    }
    weights[x] = Exp((-kSqrt2 / reach.sigma) * std::sqrt(1.0f + reach.stretch * square));
  }
}

void RecurseRows(const RecurseArgs& args, const float* const* weights) {
  HWY_DYNAMIC_DISPATCH(RecurseRows)(args, weights);
}
void RecurseRowsEvenly(const RecurseArgs& args, float weight) {
  HWY_DYNAMIC_DISPATCH(RecurseRowsEvenly)(args, weight);
}
void PullRow(const float* weight, const float* from, int count, float* to) {
  HWY_DYNAMIC_DISPATCH(PullRow)(weight, from, count, to);
}
void PullRowEvenly(float weight, const float* from, int count, float* to) {
  HWY_DYNAMIC_DISPATCH(PullRowEvenly)(weight, from, count, to);
}
void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights) {
  HWY_DYNAMIC_DISPATCH(LinkRow)(args, reach, weights);
}

}  // namespace lumifold::filter
#endif
