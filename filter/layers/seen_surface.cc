#include "filter/layers/seen_surface.h"

#include <string>

#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

constexpr float kMostInFront = 0.5f;  // of a pixel: what is seen first with more of it hides what is behind

/// What there is to know of one surface.
struct SurfaceViews {
  ConstColorView albedo, normal;
  ConstFloatView distance, mask;
};

SurfaceViews FirstSurface(const LayeredImage& film) {
  return {film.GetColor(layers::kAlbedo),
          {film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)},
          film.Get(layers::kDistance),
          film.Get(layers::kMask)};
}

bool HasLevel(const LayeredImage& film, layers::Level level) {
  return film.HasColor(layers::OfLevel(level, layers::kAlbedo)) &&
         film.Has(layers::OfLevel(level, layers::kMask));
}

SurfaceViews SurfaceOf(const LayeredImage& film, layers::Level level) {
  const auto channel = [&](std::string_view name) { return film.Get(layers::OfLevel(level, name)); };
  return {film.GetColor(layers::OfLevel(level, layers::kAlbedo)),
          {channel(layers::kNormalX), channel(layers::kNormalY), channel(layers::kNormalZ)},
          channel(layers::kDistance),
          channel(layers::kMask)};
}

/// Puts a level, none of whose levels in front is left to come, behind what is seen of them.
void AddLevel(const SurfaceViews& level, TaskPool* pool, SeenSurface* seen) {
  ForEachBand(pool, seen->mask.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < seen->mask.width(); ++x) {
        for (size_t c = 0; c < 3; ++c) seen->albedo[c].At(x, y) += level.albedo[c].At(x, y);
        float& mask = seen->mask.At(x, y);
        if (mask >= kMostInFront || level.mask.At(x, y) <= mask || !(level.distance.At(x, y) > 0)) continue;
        for (size_t c = 0; c < 3; ++c) seen->normal[c].At(x, y) = level.normal[c].At(x, y);
        seen->distance.At(x, y) = level.distance.At(x, y);
        mask = level.mask.At(x, y);
      }
    }
  });
}

}  // namespace

SeenSurface SeenSurfaceOf(const LayeredImage& film, TaskPool* pool) {
  const SurfaceViews first = FirstSurface(film);
  SeenSurface seen{MakeUninitializedPlanes(3, film.width(), film.height()),
                   MakeUninitializedPlanes(3, film.width(), film.height()),
                   Plane::Uninitialized(film.width(), film.height()),
                   Plane::Uninitialized(film.width(), film.height())};
  for (size_t c = 0; c < 3; ++c) {
    CopyPlane(first.albedo[c], seen.albedo[c].view());
    CopyPlane(first.normal[c], seen.normal[c].view());
  }
  CopyPlane(first.distance, seen.distance.view());
  CopyPlane(first.mask, seen.mask.view());
  for (int depth = 1; depth <= layers::kMaxDepth; ++depth) {
    for (const layers::Branch branch : {layers::Branch::kReflection, layers::Branch::kTransmission}) {
      const layers::Level level{branch, depth};
      if (HasLevel(film, level)) AddLevel(SurfaceOf(film, level), pool, &seen);
    }
  }
  return seen;
}

}  // namespace lumifold::filter
