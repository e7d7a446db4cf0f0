#include "filter/kernels/fit_kernels.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filter/kernels/fit_kernels.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::filter {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Numbers from k on, of n terms from `term` on: the sums stay in registers.
template <size_t n>
HWY_INLINE void AddTerms(const FitRows& samples, size_t term, size_t k, float* sums) {
  const hn::CappedTag<float, kFitRowPadding> d;
  hn::Vec<decltype(d)> at[n];
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i) at[i] = hn::LoadU(d, sums + (term + i) * samples.row + k);
  const float* row = samples.rows + k;
  const float* weighted = samples.weighted + term;
  for (size_t s = 0; s < samples.count; ++s, row += samples.row, weighted += samples.terms) {
    const auto numbers = hn::LoadU(d, row);
#pragma GCC unroll 4
    for (size_t i = 0; i < n; ++i) at[i] = hn::Add(at[i], hn::Mul(hn::Set(d, weighted[i]), numbers));
  }
#pragma GCC unroll 4
  for (size_t i = 0; i < n; ++i) hn::StoreU(at[i], d, sums + (term + i) * samples.row + k);
}

HWY_ATTR void AddFitRows(const FitRows& samples, float* sums) {
  const size_t lanes = hn::Lanes(hn::CappedTag<float, kFitRowPadding>());
  size_t term = 0;
  const auto add = [&]<size_t n>() HWY_ATTR {
    for (; term + n <= samples.terms; term += n) {
      for (size_t k = 0; k < samples.signals + term + n; k += lanes) AddTerms<n>(samples, term, k, sums);
    }
  };
  add.template operator()<4>();
  add.template operator()<1>();
}

HWY_ATTR void LikenessOf(const LikeArgs& args, float* weights) {
  const hn::CappedTag<float, kLikePadding> d;
  const auto set = [&](float value) HWY_ATTR { return hn::Set(d, value); };
  for (size_t i = 0; i < args.count; i += hn::Lanes(d)) {
    const auto square_of = [&](size_t k) HWY_ATTR {
      const float* numbers = args.numbers + k * args.stride;
      const auto off = hn::Sub(hn::LoadU(d, numbers + args.first + i), set(numbers[args.centre]));
      return hn::Mul(off, off);
    };
    auto sum0 = square_of(0), sum1 = square_of(1), sum2 = square_of(2), sum3 = square_of(3);
    for (size_t k = 4; k < args.traits; k += 4) {
      sum0 = hn::Add(sum0, square_of(k));
      sum1 = hn::Add(sum1, square_of(k + 1));
      sum2 = hn::Add(sum2, square_of(k + 2));
      sum3 = hn::Add(sum3, square_of(k + 3));
    }
    const auto apart = hn::Add(square_of(args.traits), square_of(args.traits + 1));
    const auto square =
        hn::Add(hn::Mul(set(args.falloff), apart), hn::Add(hn::Add(sum0, sum1), hn::Add(sum2, sum3)));
    const auto part = hn::Sub(set(1), hn::Div(square, set(args.most)));
    const auto cube = hn::Mul(hn::Mul(part, part), part);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(part, hn::Zero(d)), cube), d, weights + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::filter
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::filter {

HWY_EXPORT(AddFitRows);
HWY_EXPORT(LikenessOf);

void AddFitRows(const FitRows& samples, float* sums) { HWY_DYNAMIC_DISPATCH(AddFitRows)(samples, sums); }
void LikenessOf(const LikeArgs& args, float* weights) { HWY_DYNAMIC_DISPATCH(LikenessOf)(args, weights); }

}  // namespace lumifold::filter
#endif
