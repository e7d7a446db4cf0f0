#pragma once

#include <array>
#include <cstddef>

namespace lumifold::filter {

inline constexpr size_t kTerms = 11;    // 1, T (3), normal (3), covered part, S, log distance, roughness
inline constexpr size_t kSignals = 12;  // C of half A (3), of half B (3); C - F of half A (3), of half B (3)
inline constexpr size_t kRowSize = 24;  // of both, padded to whole vectors

/// One pixel as a row of the regression, in units of the picture's mean.
struct FitSample {
  std::array<float, kRowSize> row = {};  // signals, then terms
  float variance = 0;                    // of C, mean over the channels
  float power = 0;                       // mean of F^2 over the channels
};

/// The signals as linear functions of the terms: for each term a slope for each signal.
using LinearModel = std::array<float, kTerms * kSignals>;

/// Weighted least squares over samples whose terms are relative to those of `centre`. A slope's prior is
/// normal around 0; noisier samples leave it more weight: Bayesian linear regression.
class LinearFit {
 public:
  /// `slope`: deviation of the prior; over a term's unit, C changes by so many times F.
  explicit LinearFit(float slope) : slope_(slope) {}

  void Add(const FitSample& sample, const FitSample& centre, float weight);

  /// The model, of absolute terms. Consumes the sums.
  LinearModel Solve(const FitSample& centre);

 private:
  /// Variance of the samples over the variance of a slope's prior.
  float Ridge() const;

  /// Adds by * row to the sums of term i. The matrix is symmetric: columns of later terms are left out, but
  /// for what fills vectors.
  void AddTimes(float by, const std::array<float, kRowSize>& row, size_t i);

  std::array<std::array<float, kRowSize>, kTerms> sums_ = {};
  float slope_;
  float variance_ = 0;
  float power_ = 0;
};

}  // namespace lumifold::filter
