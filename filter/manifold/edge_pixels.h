#pragma once

#include "absl/functional/function_ref.h"
#include "filter/image/layered_image.h"
#include "filter/image/layers.h"

namespace lumifold::filter {

/// Calls body(row, x, y) for each row of an edge set (see EdgedImage; null or without channels: none) whose
/// pixel lies in `bounds`.
inline void ForEachEdgePixel(const LayeredImage* edges, const Rect& bounds,
                             absl::FunctionRef<void(int, int, int)> body) {
  if (edges == nullptr || edges->channels().empty()) return;
  const ConstFloatView xs = edges->Get(layers::kPixelX);
  const ConstFloatView ys = edges->Get(layers::kPixelY);
  for (int row = 0; row < edges->height(); ++row) {
    const int x = static_cast<int>(xs.At(0, row));
    const int y = static_cast<int>(ys.At(0, row));
    if (bounds.Contains(x, y)) body(row, x, y);
  }
}

}  // namespace lumifold::filter
