#include "filter/layers/edge_views.h"

#include <algorithm>

#include "filter/image/layers.h"

namespace lumifold::filter {

EdgeViews::EdgeViews(const LayeredImage& edges)
    : x(edges.Get(layers::kPixelX)),
      y(edges.Get(layers::kPixelY)),
      distance(edges.Get(layers::kDistance)),
      id(edges.Get(layers::kObjectId)),
      mask(edges.Get(layers::kMask)),
      normal{edges.Get(layers::kNormalX), edges.Get(layers::kNormalY), edges.Get(layers::kNormalZ)},
      albedo(edges.GetColor(layers::kAlbedo)),
      emission(edges.GetColor(layers::kEmission)) {}

void EdgeViews::ForEachPixel(const Rect& bounds, absl::FunctionRef<void(int, int, int)> body) const {
  for (int row = 0; row < id.height(); ++row) {
    const int px = static_cast<int>(x.At(0, row));
    const int py = static_cast<int>(y.At(0, row));
    const float* ids = id.Row(row);
    const bool hits = std::any_of(ids, ids + id.width(), [](float instance) { return instance > 0; });
    if (hits && bounds.Contains(px, py)) body(row, px, py);
  }
}

}  // namespace lumifold::filter
