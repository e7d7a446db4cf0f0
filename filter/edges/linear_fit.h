#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "filter/kernels/fit_kernels.h"
#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

/// A sample of a regression, in units of the picture's mean: a row of kSignals signals, then kTerms terms, of
/// which the first is 1.
template <size_t kTerms, size_t kSignals>
struct FitSample {
  static constexpr size_t kLanes = 4;
  static constexpr size_t kRow =
      (kSignals + kTerms + kLanes - 1) / kLanes * kLanes;  // padded to whole vectors
  static_assert(kRow % kFitRowPadding == 0);

  std::array<float, kRow> row = {};
  float variance = 0;  // of the picture, mean over the channels
  float power = 0;     // mean of F^2 over the channels
};

/// The signals as linear functions of the terms, less those of the centre that was fitted: for each term a
/// slope for each signal.
template <size_t kTerms, size_t kSignals>
using LinearModel = std::array<float, kTerms * kSignals>;

/// Weighted least squares over samples whose terms are relative to those of `centre`. A slope's prior is
/// normal around 0; noisier samples leave it more weight: Bayesian linear regression.
template <size_t kTerms, size_t kSignals>
class LinearFit {
 public:
  using Sample = FitSample<kTerms, kSignals>;

  /// `slope`: deviation of the prior; over a term's unit, the picture changes by so many times F.
  explicit LinearFit(float slope) : slope_(slope) {}

  void Add(const Sample& sample, const Sample& centre, float weight) {
    variance_ += weight * sample.variance;
    power_ += weight * sample.power;
    std::array<float, Sample::kRow>& row = rows_[count_];
    row = sample.row;
    for (size_t i = 1; i < kTerms; ++i) row[kSignals + i] -= centre.row[kSignals + i];
    for (size_t i = 0; i < kTerms; ++i) weighted_[count_][i] = weight * row[kSignals + i];
    if (++count_ == kTogether) AddRows();
  }

  bool IsEmpty() {
    AddRows();
    return !(sums_[0][kSignals] > 0);
  }

  /// The model, unless the fit is empty. Consumes the sums.
  LinearModel<kTerms, kSignals> Solve() {
    AddRows();
    const float ridge = Ridge();
    for (size_t i = 1; i < kTerms; ++i) sums_[i][kSignals + i] += ridge;
    // Elimination from the last term up to the constant, whose row then stands alone. No pivoting: the ridge
    // keeps the matrix positive definite.
    for (size_t k = kTerms - 1; k > 0; --k) {
      const float inverse = 1.0f / sums_[k][kSignals + k];
      for (size_t i = 0; i < k; ++i) AddTimes(-sums_[k][kSignals + i] * inverse, sums_[k], i);
    }
    LinearModel<kTerms, kSignals> model = {};
    for (size_t i = 0; i < kTerms; ++i) {
      const float inverse = 1.0f / sums_[i][kSignals + i];
      for (size_t s = 0; s < kSignals; ++s) {
        float right = sums_[i][s];
        for (size_t j = 0; j < i; ++j) right -= sums_[i][kSignals + j] * model[j * kSignals + s];
        model[i * kSignals + s] = right * inverse;
      }
    }
    return model;
  }

 private:
  /// Variance of the samples over the variance of a slope's prior.
  float Ridge() const {
    const float weight = sums_[0][kSignals];
    const float expected = slope_ * slope_ * (power_ + kMinFitPower * weight);
    return std::min(variance_ / expected, kMaxFitRidge * weight) + kMinFitRidge * weight;
  }

  /// Adds by * row to the sums of term i. The matrix is symmetric: columns of later terms are left out, but
  /// for what fills vectors.
  void AddTimes(float by, const std::array<float, Sample::kRow>& row, size_t i) {
    for (size_t j = 0; j <= kSignals + i; j += Sample::kLanes) {
      for (size_t k = j; k < j + Sample::kLanes; ++k) sums_[i][k] += by * row[k];
    }
  }

  /// Adds the rows that wait to the sums.
  void AddRows() {
    AddFitRows({rows_[0].data(), weighted_[0].data(), count_, Sample::kRow, kSignals, kTerms},
               sums_[0].data());
    count_ = 0;
  }

  static constexpr size_t kTogether = 64;  // rows: few enough for the first cache

  std::array<std::array<float, Sample::kRow>, kTerms> sums_ = {};
  std::array<std::array<float, Sample::kRow>, kTogether> rows_;  // relative to the centre; count_ of them
  std::array<std::array<float, kTerms>, kTogether> weighted_;    // their terms times their weights
  size_t count_ = 0;
  float slope_;
  float variance_ = 0;
  float power_ = 0;
};

}  // namespace lumifold::filter
