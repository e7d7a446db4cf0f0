#include "filter/baselines/manifolds_color.h"

#include <algorithm>
#include <cmath>

#include "filter/baselines/display_color.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {
namespace {

Planes GuideOf(const Planes& color, int patch_radius, ConstFloatView mask, TaskPool* pool) {
  if (patch_radius > 0) {
    return ProjectPatches(color, FitPatchBasis(color, mask, {.radius = patch_radius}, pool), pool);
  }
  return Clone(color);
}

Picture Filter(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const float sigma_s = values[0];
  const float sigma_r = values[1];
  const int patch_radius = static_cast<int>(values[2]);
  const Planes color = DisplayColor(film.pixels, pool);
  Plane mask = MakePlane(color[0].width(), color[0].height(), 1.0f);
  Planes guide = GuideOf(color, patch_radius, mask.view(), pool);
  for (Plane& plane : guide) {
    ForEachPixel(plane.width(), plane.height(), [&](int x, int y) { plane.At(x, y) /= sigma_r; });
  }
  ManifoldParams params;
  params.sigma_s = sigma_s;
  params.height = TreeHeight(sigma_s, sigma_r, patch_radius > 0);
  return LinearColor(ManifoldFilter(color, guide, mask.view(), params, pool), pool);
}

}  // namespace

int TreeHeight(float sigma_s, float sigma_r, bool has_patches) {
  constexpr int kOfPatches = 2;
  const float octaves = std::floor(std::log2(sigma_s)) - 1.0f;
  return std::max(2, static_cast<int>(std::ceil(octaves * (1.0f - sigma_r)))) +
         (has_patches ? kOfPatches : 0);
}

Baseline ManifoldsColorBaseline() {
  return {.info = {.name = "manifolds-color",
                   .summary = "adaptive manifolds on the finished colours, no layers, no geometry",
                   .source = "Gastal & Oliveira 2012",
                   .parameters =
                       {{"sigma_s", "reach in pixels", 16, {8, 16, 32}, 1, 64},
                        {"sigma_r", "range of displayed colour", 0.2f, {0.05f, 0.1f, 0.2f, 0.4f}, 0.01f, 1},
                        {"patch", "radius of the patches that guide; 0: colours", 0, {0, 3}, 0, 5}},
                   .uses_auxiliary = false},
          .filter = Filter};
}

}  // namespace lumifold::filter
