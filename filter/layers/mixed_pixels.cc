#include "filter/layers/mixed_pixels.h"

#include <algorithm>

#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

void AddEdges(const Frame& frame, Plane* mixed) {
  frame.edges->ForEachPixel(frame.bounds(), [&](int, int x, int y) {
    mixed->At(x, y) = 1;
    const Rect around = Inflate({x, y, x + 1, y + 1}, 1, frame.bounds());
    for (int j = around.y0; j < around.y1; ++j) {
      for (int i = around.x0; i < around.x1; ++i) {
        if (frame.surface.mask.At(i, j) > 0) mixed->At(i, j) = 1;
      }
    }
  });
}

}  // namespace

Plane MixedPixelsOf(const Frame& frame, float mixed_albedo) {
  Plane mixed = frame.level_mask.Clone();
  if (frame.edges.has_value()) AddEdges(frame, &mixed);
  const ConstColorView& glossy = frame.gloss.albedo;
  if (glossy[0].IsEmpty()) return mixed;
  ForEachPixel(frame.width, frame.height, [&](int x, int y) {
    if (LuminanceAt(glossy, x, y) > mixed_albedo) mixed.At(x, y) = 1;
  });
  return mixed;
}

Plane MixedPart(const Plane& mixed, const Rect& box) {
  const ConstFloatView part = mixed.view().Crop(box);
  for (int y = 0; y < part.height(); ++y) {
    const float* row = part.Row(y);
    if (std::any_of(row, row + part.width(), [](float is_mixed) { return is_mixed > 0; })) return Clone(part);
  }
  return {};
}

}  // namespace lumifold::filter
