#include "filter/layers/seen_surface.h"

#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

/// Part of a pixel at which the surface in front hides what is behind it.
constexpr float kDominantPart = 0.5f;

/// Adds a level behind the surfaces found so far. Levels come in the order of their depth.
void AddLevel(const SurfaceViews& level, TaskPool* pool, SeenSurface* seen) {
  ForEachPixel(pool, seen->mask.width(), seen->mask.height(), [&](int x, int y) {
    for (size_t c = 0; c < 3; ++c) seen->albedo[c].At(x, y) += level.albedo[c].At(x, y);
    float& mask = seen->mask.At(x, y);
    if (mask >= kDominantPart || level.mask.At(x, y) <= mask || !(level.distance.At(x, y) > 0)) return;
    for (size_t c = 0; c < 3; ++c) seen->normal[c].At(x, y) = level.normal[c].At(x, y);
    seen->distance.At(x, y) = level.distance.At(x, y);
    mask = level.mask.At(x, y);
  });
}

}  // namespace

SeenSurface SeenSurfaceOf(const Frame& frame, TaskPool* pool) {
  const SurfaceViews& first = frame.surface;
  SeenSurface seen{ClonePlanes(first.albedo), ClonePlanes(first.normal), Clone(first.distance),
                   Clone(first.mask)};
  for (int depth = 1; depth <= layers::kMaxDepth; ++depth) {
    for (const LevelViews& level : frame.levels) {  // reflection before transmission
      const bool is_known = !level.surface.albedo[0].IsEmpty() && !level.surface.mask.IsEmpty() &&
                            !level.surface.normal[0].IsEmpty() && !level.surface.distance.IsEmpty();
      if (level.level.depth == depth && is_known) AddLevel(level.surface, pool, &seen);
    }
  }
  return seen;
}

}  // namespace lumifold::filter
