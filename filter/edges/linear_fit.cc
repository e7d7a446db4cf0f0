#include "filter/edges/linear_fit.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

constexpr float kMinPower = 1e-3f;  // F^2 counts as at least this, over the mean's square
constexpr float kMinRidge = 1e-5f;  // over the window's weight
constexpr float kMaxRidge = 1;      // over the same

}  // namespace

void LinearFit::Add(const FitSample& sample, const FitSample& centre, float weight) {
  variance_ += weight * sample.variance;
  power_ += weight * sample.power;
  std::array<float, kRowSize> row = sample.row;
  for (size_t i = 1; i < kTerms; ++i) row[kSignals + i] -= centre.row[kSignals + i];
  for (size_t i = 0; i < kTerms; ++i) AddTimes(weight * row[kSignals + i], row, i);
}

LinearModel LinearFit::Solve(const FitSample& centre) {
  const float ridge = Ridge();
  for (size_t i = 1; i < kTerms; ++i) sums_[i][kSignals + i] += ridge;
  // Elimination from the last term up to the constant, whose row then stands alone. No pivoting: the ridge
  // keeps the matrix positive definite.
  for (size_t k = kTerms - 1; k > 0; --k) {
    const float inverse = 1.0f / sums_[k][kSignals + k];
    for (size_t i = 0; i < k; ++i) AddTimes(-sums_[k][kSignals + i] * inverse, sums_[k], i);
  }
  LinearModel model = {};
  for (size_t i = 0; i < kTerms; ++i) {
    const float inverse = 1.0f / sums_[i][kSignals + i];
    for (size_t s = 0; s < kSignals; ++s) {
      float right = sums_[i][s];
      for (size_t j = 0; j < i; ++j) right -= sums_[i][kSignals + j] * model[j * kSignals + s];
      model[i * kSignals + s] = right * inverse;
    }
  }
  for (size_t i = 1; i < kTerms; ++i) {
    for (size_t s = 0; s < kSignals; ++s) model[s] -= model[i * kSignals + s] * centre.row[kSignals + i];
  }
  return model;
}

float LinearFit::Ridge() const {
  const float weight = sums_[0][kSignals];
  const float expected = slope_ * slope_ * (power_ + kMinPower * weight);
  return std::min(variance_ / expected, kMaxRidge * weight) + kMinRidge * weight;
}

void LinearFit::AddTimes(float by, const std::array<float, kRowSize>& row, size_t i) {
  constexpr size_t kLanes = 4;
  for (size_t j = 0; j <= kSignals + i; j += kLanes) {
    for (size_t k = j; k < j + kLanes; ++k) sums_[i][k] += by * row[k];
  }
}

}  // namespace lumifold::filter
