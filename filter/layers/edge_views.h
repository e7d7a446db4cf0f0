#pragma once

#include "absl/functional/function_ref.h"
#include "filter/image/layered_image.h"

namespace lumifold::filter {

/// The channels of an edge set (see EdgedImage): one row per edge pixel, one column per sub-sample.
struct EdgeViews {
  ConstFloatView x, y, distance, id, mask;
  ConstColorView normal, albedo, emission;

  explicit EdgeViews(const LayeredImage& edges);

  /// Whether the sub-sample hits a surface with a diffuse lobe.
  bool IsLit(int sample, int row) const { return mask.At(sample, row) > 0 && distance.At(sample, row) > 0; }

  /// Calls body(row, x, y) for each row whose pixel lies in `bounds` and of which any sub-sample hits
  /// something. A pixel without a hit is sky, and C is all that is known of it.
  void ForEachPixel(const Rect& bounds, absl::FunctionRef<void(int, int, int)> body) const;
};

}  // namespace lumifold::filter
