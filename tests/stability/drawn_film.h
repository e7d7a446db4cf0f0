#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "filter/image/edged_image.h"
#include "filter/image/planes.h"

namespace lumifold::stability {

/// R G B, or X Y Z.
using Triple = std::array<float, 3>;

constexpr Triple Gray(float value) { return {value, value, value}; }

/// What is seen at a point of a drawing.
struct Surface {
  int object = 1;  // 0: sky, which has its emission alone
  bool has_diffuse = true;
  Triple normal = {0, 0, 1};
  float distance = 5;
  Triple albedo = {1, 1, 1};
  Triple direct = {0, 0, 0};
  Triple indirect = {0, 0, 0};
  Triple emission = {0, 0, 0};
};

/// A scene whose light is known everywhere: what is seen at (x, y), in pixels from the top left corner.
using Drawing = std::function<Surface(float x, float y)>;

/// How a drawing is sampled.
struct Sampling {
  uint32_t samples = 16;  // per pixel; the first half (rounded up) is half A
  uint32_t seed = 1;
  float noise = 1;          // relative deviation of one sample's D and of its I, at most 1
  double spike_chance = 0;  // of a pixel's D to be spike_factor times as bright in one of its halves
  float spike_factor = 1;
  float feature_noise = 0;  // deviation of one sample's normal, and relative of its distance, as out of focus
  int truth_grid = 4;       // a pixel's truth is the mean over so many by so many points
};

/// A film and its truth.
struct DrawnFilm {
  EdgedImage film;
  Picture truth;  // R G B
};

/// Samples a drawing as a path tracer would: each sample is a random point of the truth's grid, its D and I
/// are multiplied by noise of mean 1 with a long tail, and C = (D + I) T + E. Geometry and the sub-samples of
/// edges are without chance, as those of a geometry unit are. The result depends on the arguments alone.
DrawnFilm DrawFilm(int width, int height, const Drawing& drawing, const Sampling& sampling);

}  // namespace lumifold::stability
