#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

namespace lumifold::filter {

struct RegressionParams {
  float sigma_px = 4;        // of a sample's weight by its distance in the picture; windows reach 1.5 sigma
  float sigma_light = 0.3f;  // of its weight by F, stabilised
  float slope = 4;  // deviation of a slope's prior: over a term's unit, light changes by so many times F
};

inline int WindowRadius(const RegressionParams& params) {
  return static_cast<int>(std::lround(1.5f * params.sigma_px));
}

/// Radius in pixels of what a pixel of a regression depends on.
inline int RegressionWindow(const RegressionParams& params) { return 2 * WindowRadius(params); }

/// 1 / sigma^2 of a sample's weight by its distance.
inline float FalloffOf(const RegressionParams& params) { return 1.0f / (params.sigma_px * params.sigma_px); }

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

// Samples of FitLight (filter/edges/light_regression.h), which devices read by themselves.

inline constexpr int kMostLightTerms = 5;        // of features: the last ones, those of the surface
inline constexpr int kMostLightFeatures = 8;     // that tell samples apart
inline constexpr float kMaxLightSignal = 1e12f;  // light over its mean: fourth powers must stay finite
/// Terms: 1, x, y, features. Signals: light of half A (3), of half B (3), padded to whole vectors. Traits:
/// asinh(F / knee) / sigma_light, features; padded.
inline constexpr FitShape kLightShape = {3 + kMostLightTerms, 8, 12};
static_assert(3 + kMostLightFeatures <= kLightShape.traits);

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
