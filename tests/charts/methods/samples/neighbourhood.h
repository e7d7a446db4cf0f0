#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "absl/types/span.h"
#include "tests/charts/methods/samples/sample_set.h"

namespace lumifold::charts {

/// The variables of a sample: its position in the picture, its colour, its random numbers, and the features
/// of the surface it hit.
struct Variables {
  static constexpr size_t kPosition = 0;
  static constexpr size_t kColor = kPosition + 2;
  static constexpr size_t kRandom = kColor + 3;
  static constexpr size_t kFeature = kRandom + 2 + 2 * render::kFirstSurfacePairs;
  static constexpr size_t kWorld = kFeature;  // the features that are the position in world space
  static constexpr size_t kCount = kFeature + 9;
  using Values = std::array<float, kCount>;

  static Values Of(const ChartSample& sample, scene::Vec3 color);
};

/// The samples that random parameter filtering uses for one pixel: first its own, then samples of similar
/// features drawn from around the pixel, nearer ones more often.
class Neighbourhood {
 public:
  /// Draws up to `most` samples from a box of `side` pixels, by a random stream keyed by (pixel, pass).
  /// `colors`: the current colours of the set's samples.
  void Draw(const SampleSet& set, const std::vector<scene::Vec3>& colors, int x, int y, int pass, int side,
            size_t most);

  size_t size() const { return colors_.size(); }
  /// A variable of all samples, normalised to mean 0 and standard deviation 1; 0 if it does not vary.
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
