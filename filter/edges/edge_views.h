#pragma once

#include <vector>

#include "filter/image/layered_image.h"

namespace lumifold::filter {

/// The edge set's channels (see EdgedImage).
struct EdgeViews {
  ConstFloatView x, y, distance, id, mask;
  ConstColorView normal, albedo, emission;

  explicit EdgeViews(const LayeredImage& edges);

  /// Whether the sub-sample shows a surface with a diffuse lobe.
  bool IsLit(int sample, int row) const { return mask.At(sample, row) > 0 && distance.At(sample, row) > 0; }

  /// Whether all its light is known from D, I, T and E: sky, lamps and diffuse surfaces.
  bool IsPlain(int sample, int row) const;

  /// IsPlain() of all sub-samples.
  bool IsPlain(int row) const;
};

/// Pixels of the film whose picture D, I, T and E do not tell: they show a level, or more than
/// `max_glossy_albedo` of their light is reflected by glossy lobes.
class UnknownPixels {
 public:
  UnknownPixels(const LayeredImage& film, float max_glossy_albedo);

  bool Contain(int x, int y) const;

 private:
  float max_glossy_albedo_;
  ConstColorView glossy_albedo_;
  std::vector<ConstFloatView> levels_;  // their sample counts
};

}  // namespace lumifold::filter
