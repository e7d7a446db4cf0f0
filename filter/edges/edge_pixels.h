#pragma once

#include <algorithm>

#include "absl/functional/function_ref.h"
#include "filter/image/layered_image.h"
#include "filter/image/layers.h"

namespace lumifold::filter {

/// Whether any sub-sample of an edge set's row hits something; else the pixel is sky, and C all there is to
/// know of it.
inline bool HitsAnything(const ConstFloatView& ids, int row) {
  const float* id = ids.Row(row);
  return std::any_of(id, id + ids.width(), [](float instance) { return instance > 0; });
}

/// Calls body(row, x, y) for each row of an edge set (see EdgedImage; null or without channels: none) that
/// hits anything and whose pixel lies in `bounds`.
inline void ForEachEdgePixel(const LayeredImage* edges, const Rect& bounds,
                             absl::FunctionRef<void(int, int, int)> body) {
  if (edges == nullptr || edges->channels().empty()) return;
  const ConstFloatView xs = edges->Get(layers::kPixelX);
  const ConstFloatView ys = edges->Get(layers::kPixelY);
  const ConstFloatView ids = edges->Get(layers::kObjectId);
  for (int row = 0; row < edges->height(); ++row) {
    const int x = static_cast<int>(xs.At(0, row));
    const int y = static_cast<int>(ys.At(0, row));
    if (bounds.Contains(x, y) && HitsAnything(ids, row)) body(row, x, y);
  }
}

}  // namespace lumifold::filter
