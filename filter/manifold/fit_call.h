#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

namespace lumifold::filter {

// Constants of the local linear models of ModelGrid (filter/edges/model_grid.h), which devices fit, too.

inline constexpr float kMinFitPower = 1e-3f;  // F^2 counts as at least this, over the mean's square
inline constexpr float kMinFitRidge = 1e-5f;  // over the window's weight
inline constexpr float kMaxFitRidge = 1;      // over the same
inline constexpr int kFitStep = 3;            // pixels from model to model
/// Samples with less weight of models around them have one of their own.
inline constexpr float kMinModelWeight = 1;
/// Of a distance in sigmas, from which on weights are 0.
inline constexpr float kMaxFitSquare = 10;

/// Numbers of a sample of a ModelGrid.
struct FitShape {
  int32_t terms = 1, signals = 1;
  int32_t traits = 4;  // a multiple of 4

  /// Signals and terms, padded to a multiple of 4.
  constexpr int32_t Row() const { return (signals + terms + 3) / 4 * 4; }
  /// Floats of a sample: the row, its variance and power, the traits, the weight, x and y.
  constexpr int32_t Sample() const { return Row() + 2 + traits + 3; }
  auto operator<=>(const FitShape&) const = default;
};

/// Samples to which models are fitted, as ModelGrid has them, pixel by pixel.
struct FitCall {
  FitShape shape;
  int32_t width = 1, height = 1;     // of the picture
  int32_t radius = 1;                // of windows, px
  float falloff = 1;                 // 1 / sigma^2 of a sample's weight by its distance, 1 / px^2
  float slope = 1;                   // RegressionParams::slope
  absl::Span<const int32_t> firsts;  // of each pixel, the number of its first sample; one more at the end
  absl::Span<const float> samples;
  absl::Span<const int32_t> targets;  // numbers of samples, ascending: those of the pixels that are fitted

  size_t Count() const { return samples.size() / static_cast<size_t>(shape.Sample()); }
  const float* Sample(int32_t i) const {
    return samples.data() + static_cast<size_t>(i) * static_cast<size_t>(shape.Sample());
  }
  /// Whether a target is the centre of a model.
  bool IsCentre(int32_t target) const {
    const float* const end = Sample(target) + shape.Sample();
    return end[-3] > 0 && static_cast<int>(end[-2]) % kFitStep == 0 &&
           static_cast<int>(end[-1]) % kFitStep == 0;
  }
};

/// At each target, the sums over models of their weight there times the signals that they say, and of the
/// weight.
struct FitResult {
  std::vector<float> values;
  std::vector<float> totals;
};

}  // namespace lumifold::filter
