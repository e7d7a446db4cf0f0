#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"
#include "filter/manifold/fit_call.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {

/// Views of planes, which stay the caller's.
using PlaneViews = std::vector<ConstFloatView>;

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

/// Features above this count as unusable: their squared distances must stay finite.
inline constexpr float kLargestFeature = 1e6f;

/// Filterings of both halves, each guided by the other half of a picture.
struct GuidedHalves {
  ManifoldParams manifolds;
  PatchParams patches;        // of the picture
  float sigma_q = 1;          // range of their coordinates
  std::vector<float> scales;  // one filtering of each half for each; coordinates are multiplied by it
};

/// What was removed from a layer as fireflies: ReturnRemoved() (filter/denoise/firefly.h) returns it.
struct RemovedLight {
  std::array<PlaneViews, 2> planes;  // 3 of each half
  bool returns = true;               // false: none does
  float spread_light = 1;            // FireflyParams
  int spread_height = 1;
};

/// Halves (filter/layers/halves.h) as planes of one size. Index 0 of a pair is half A, 1 is half B.
struct HalvesOfLayer {
  std::array<PlaneViews, 2> light;      // 3
  std::array<ConstFloatView, 2> masks;  // weight_a, weight_b
  ConstFloatView weight, share_a, samples;
  // May be empty:
  ConstFloatView picture_light, expected_difference, is_mixed;
  float level = 1;
};

/// The fragments of a layer; a value of each, or as many as is said.
struct PointsOfLayer {
  std::array<const SlicePoints*, 2> of_halves = {};   // light and shares; null: there are none
  std::array<absl::Span<const float>, 2> uncut = {};  // 3: light with fireflies
  std::array<absl::Span<const float>, 2> coverage = {};
  absl::Span<const float> offsets = {};                // 2: LayerFragments::offsets
  absl::Span<const float> weights = {}, samples = {};  // as ChoicePoints has them

  size_t Count() const { return of_halves[0] != nullptr ? of_halves[0]->pixels.size() : 0; }
};

/// A layer whose two halves are known, through all stages from the first filtering to the choice of the noisy
/// layer (filter/denoise/layer_stages.h).
struct LayerCall {
  HalvesOfLayer halves;
  PointsOfLayer points;
  PlaneViews geometry;   // features
  float knee = 1;        // of stabilised guides, over the level
  float reach_px = 1;    // of all blurs along manifolds
  GuidedHalves first;    // of the noisy layer, guided by it; with one scale
  GuidedHalves further;  // of what the first leaves, guided by its result
  ChoiceParams choice;
  std::optional<RegressionParams> fit;  // of the light; then there are mixed pixels
  std::optional<RemovedLight> removed;
  bool may_stay_noisy = true;  // whether the noisy layer is compared at last
};

/// The filtered halves, without weights of points, and FilteredLayer::returned in the halves' unit (3 planes;
/// none).
struct LayerResult {
  std::array<ManifoldResult, 2> halves;
  Planes returned;
};

}  // namespace lumifold::filter
