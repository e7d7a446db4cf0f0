#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "absl/types/span.h"
#include "tests/charts/methods/samples/sample_set.h"

namespace lumifold::charts {

/// What is known of a sample, variable by variable: where it lies in the picture, its colour, the random
/// numbers it was made from, the features of the surface it met.
struct Variables {
  static constexpr size_t kPosition = 0;
  static constexpr size_t kColor = kPosition + 2;
  static constexpr size_t kRandom = kColor + 3;
  static constexpr size_t kFeature = kRandom + 2 + 2 * render::kFirstSurfacePairs;
  static constexpr size_t kWorld = kFeature;  // the features that are a position in the world
  static constexpr size_t kCount = kFeature + 9;
  using Values = std::array<float, kCount>;

  static Values Of(const ChartSample& sample, scene::Vec3 color);
};

/// The samples that random parameter filtering compares a pixel's own with: those first, then others drawn
/// from around the pixel, nearer ones more often, of like features.
class Neighbourhood {
 public:
  /// Draws up to `most` samples within a box of `side` pixels, by a stream keyed by (pixel, pass). `colors`:
  /// of the set's samples, as they are now.
  void Draw(const SampleSet& set, const std::vector<scene::Vec3>& colors, int x, int y, int pass, int side,
            size_t most);

  size_t size() const { return colors_.size(); }
  /// A variable of all samples, brought to mean 0 and deviation 1; what does not vary is 0.
  absl::Span<const float> Standard(size_t variable) const { return standard_[variable]; }
  const std::vector<scene::Vec3>& colors() const { return colors_; }

 private:
  void Clear();
  void Add(const Variables::Values& values, scene::Vec3 color);
  void Standardise();

  std::vector<scene::Vec3> colors_;
  std::array<std::vector<float>, Variables::kCount> standard_;
};

}  // namespace lumifold::charts
