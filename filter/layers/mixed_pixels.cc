#include "filter/layers/mixed_pixels.h"

#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

/// Glossy albedo above which nearly all light of a pixel is glossy: what it mirrors tells pixels apart, the
/// features that guide F do not.
constexpr float kMetallicAlbedo = 0.5f;

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

Plane MixedPixelsOf(const Frame& frame) {
  Plane mixed = frame.level_mask.Clone();
  if (frame.edges.has_value()) AddEdges(frame, &mixed);
  const ConstColorView& glossy = frame.glossy_albedo;
  if (glossy[0].IsEmpty()) return mixed;
  ForEachPixel(frame.width, frame.height, [&](int x, int y) {
    if (LuminanceAt(glossy, x, y) > kMetallicAlbedo) mixed.At(x, y) = 1;
  });
  return mixed;
}

}  // namespace lumifold::filter
