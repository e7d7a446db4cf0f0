#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

/// A sample of a regression, in units of the picture's mean: a row of kSignals signals, then kTerms terms, of
/// which the first is 1.
template <size_t kTerms, size_t kSignals>
struct FitSample {
  static constexpr size_t kLanes = 4;
  static constexpr size_t kRow =
      (kSignals + kTerms + kLanes - 1) / kLanes * kLanes;  // padded to whole vectors

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
    std::array<float, Sample::kRow> row = sample.row;
    for (size_t i = 1; i < kTerms; ++i) row[kSignals + i] -= centre.row[kSignals + i];
    for (size_t i = 0; i < kTerms; ++i) AddTimes(weight * row[kSignals + i], row, i);
  }

  bool IsEmpty() const { return !(sums_[0][kSignals] > 0); }

  /// The model; nothing may be empty. Consumes the sums.
  LinearModel<kTerms, kSignals> Solve() {
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

  std::array<std::array<float, Sample::kRow>, kTerms> sums_ = {};
  float slope_;
  float variance_ = 0;
  float power_ = 0;
};

}  // namespace lumifold::filter
