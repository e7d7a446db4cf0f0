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

/// The surface at a point of a drawing.
struct Surface {
  int object = 1;  // 0: sky, which has only emission
  bool has_diffuse = true;
  Triple normal = {0, 0, 1};
  float distance = 5;
  Triple albedo = {1, 1, 1};
  Triple direct = {0, 0, 0};
  Triple indirect = {0, 0, 0};
  Triple emission = {0, 0, 0};
};

/// A scene with analytic light: the surface at (x, y), in pixels from the top left corner.
using Drawing = std::function<Surface(float x, float y)>;

/// How a drawing is sampled.
struct Sampling {
  uint32_t samples = 16;  // per pixel; the first half (rounded up) is half A
  uint32_t seed = 1;
  float noise = 1;               // relative standard deviation of D and I of one sample, at most 1
  double spike_probability = 0;  // probability that D of one half of a pixel is spike_factor times as bright
  float spike_factor = 1;
  /// Factor on D of half A (0) or B (1) of a pixel, as of an outlier; null: 1 everywhere.
  std::function<float(int x, int y, int half)> direct_gain = {};
  float feature_noise =
      0;  // standard deviation of the normal, and relative of the distance, of one sample, as by defocus
  int truth_grid = 4;  // the truth of a pixel is the mean over a grid of this size squared
};

/// A film and its true picture.
struct DrawnFilm {
  EdgedImage film;
  Picture truth;  // R G B
};

/// Samples a drawing as a path tracer would: each sample is a random point of the truth's grid, its D and I
/// are multiplied by long-tailed noise of mean 1, and C = (D + I) T + E. Geometry and the sub-samples of
/// edges are not random, as in a geometry unit. The result depends only on the arguments.
DrawnFilm DrawFilm(int width, int height, const Drawing& drawing, const Sampling& sampling);

}  // namespace lumifold::stability
