#include "filter/layers/mixed_pixels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/planes.h"

namespace lumifold::filter {
namespace {

/// Limits of the normals and the distances of neighbours that show one surface: those of the renderer's edge
/// set (docs/layers.md).
constexpr float kLeastCosine = 0.9f;
constexpr float kMostBend = 0.05f;  // of the reciprocal distance, which is linear along a plane

/// Marks a pixel and those of its neighbours that have a diffuse surface.
void MarkAround(const Frame& frame, int x, int y, Plane* mixed) {
  mixed->At(x, y) = 1;
  const Rect around = Inflate({x, y, x + 1, y + 1}, 1, frame.bounds());
  for (int j = around.y0; j < around.y1; ++j) {
    for (int i = around.x0; i < around.x1; ++i) {
      if (frame.surface.mask.At(i, j) > 0) mixed->At(i, j) = 1;
    }
  }
}

float Cosine(const ConstColorView& normal, int x, int y, int i, int j) {
  float product = 0, length = 0, other = 0;
  for (const ConstFloatView& n : normal) {
    product += n.At(x, y) * n.At(i, j);
    length += n.At(x, y) * n.At(x, y);
    other += n.At(i, j) * n.At(i, j);
  }
  const float lengths = length * other;
  return lengths > 0 ? product / std::sqrt(lengths) : 1.0f;
}

/// Whether two neighbours differ in what they hit or in the normal.
bool Differ(const SurfaceViews& surface, int x, int y, int i, int j) {
  if ((surface.distance.At(x, y) > 0) != (surface.distance.At(i, j) > 0)) return true;
  if ((surface.mask.At(x, y) > 0) != (surface.mask.At(i, j) > 0)) return true;
  return Cosine(surface.normal, x, y, i, j) < kLeastCosine;
}

/// Whether the reciprocal distance at (x, y) is far from the mean of (x - dx, y - dy) and (x + dx, y + dy).
bool Bends(ConstFloatView distance, int x, int y, int dx, int dy) {
  const float here = distance.At(x, y);
  const float before = distance.At(x - dx, y - dy);
  const float after = distance.At(x + dx, y + dy);
  if (!(here > 0 && before > 0 && after > 0)) return false;
  return std::abs(here / before + here / after - 2) > kMostBend;
}

/// Whether a pixel differs from a neighbour: this tells where several surfaces meet if there is no edge set.
bool IsDiscontinuous(const Frame& frame, int x, int y) {
  const SurfaceViews& surface = frame.surface;
  for (const auto& [dx, dy] : {std::pair(1, 0), std::pair(0, 1)}) {
    const bool has_before = x >= dx && y >= dy;
    const bool has_after = x + dx < frame.width && y + dy < frame.height;
    if (has_before && Differ(surface, x, y, x - dx, y - dy)) return true;
    if (has_after && Differ(surface, x, y, x + dx, y + dy)) return true;
    if (has_before && has_after && Bends(surface.distance, x, y, dx, dy)) return true;
  }
  return false;
}

void AddEdges(const Frame& frame, Plane* mixed) {
  if (frame.edges.has_value())
    frame.edges->ForEachPixel(frame.bounds(), [&](int, int x, int y) { MarkAround(frame, x, y, mixed); });
  if (!frame.surface.is_foreign) return;
  ForEachPixel(frame.width, frame.height, [&](int x, int y) {
    if (IsDiscontinuous(frame, x, y)) MarkAround(frame, x, y, mixed);
  });
}

}  // namespace

Plane MixedPixelsOf(const Frame& frame, float mixed_albedo) {
  Plane mixed = frame.level_mask.Clone();
  AddEdges(frame, &mixed);
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
