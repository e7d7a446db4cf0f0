#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "absl/types/span.h"
#include "filter/image/plane.h"
#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

struct ManifoldCall;

struct ChoiceParams {
  /// Windows in which pictures are compared, from the widest to the narrowest: radii in pixels, of the two
  /// wide ones in multiples of kChoiceCell.
  int widest_radius = 48;
  int wide_radius = 12;
  int narrow_radius = 3;
  int blend_radius = 4;    // px: window over which shares are smoothed
  float significance = 9;  // squared standard errors by which a share must differ before it counts
  float dim = 0.3f;        // light over the mean below which errors count alike: ErrorWeight()
};

// Constants of Choice (filter/layers/choice.h), which devices have, too.

/// Side in pixels of the cells that wide windows are summed over.
inline constexpr int kChoiceCell = 4;
/// Kinds of pixels, which are compared apart: 0, those where several surfaces meet, and those with points.
inline constexpr int kMixedKind = 1;
inline constexpr int kPointKind = 2;
inline constexpr int kMostKinds = 3;
/// Part of a window's sum that one pixel may have.
inline constexpr float kMostLeverage = 0.99f;

/// The fit of light that follows the choice, as FitLight has it.
struct LightFit {
  RegressionParams params;
  float knee = 1;
};

/// Further filterings of a layer whose first one is known, the choice between all, and the fit of light with
/// its own choice. Index 0 of a pair is half A, 1 is half B.
struct RefineCall {
  /// Of half A by each range, then the same of half B. All have the same signals, the noisy halves; their
  /// bases, the first filtering; features, the geometry; and points, whose weights are the shares of their
  /// fragments. Signals of points are what the base leaves.
  absl::Span<const ManifoldCall> filterings;
  ChoiceParams choice;
  std::optional<LightFit> fit;                           // then there are mixed pixels
  float level = 1;                                       // Halves::level
  ConstFloatView weight;                                 // Halves::weight
  ConstFloatView samples;                                // Halves::samples
  ConstFloatView light;                                  // Halves::picture_light; empty: the layer's own
  ConstFloatView expected;                               // Halves::expected_difference; may be empty
  ConstFloatView mixed;                                  // Halves::is_mixed; may be empty
  std::array<absl::Span<const float>, 2> noisy, base;    // 3 of each point
  std::array<absl::Span<const float>, 2> coverage;       // of each point
  absl::Span<const float> offsets;                       // 2 of each point, as LayerFragments has them
  absl::Span<const float> point_weights, point_samples;  // as ChoicePoints has them

  /// Planes beside those of the filterings; some may be empty.
  std::array<ConstFloatView, 5> Planes() const { return {weight, samples, light, expected, mixed}; }
};

}  // namespace lumifold::filter
