#include "filter/baselines/display_color.h"

#include "filter/image/color.h"
#include "filter/image/layers.h"

namespace lumifold::filter {

Planes DisplayColor(const LayeredImage& film, TaskPool* pool) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  Planes display = MakePlanes(3, film.width(), film.height());
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < film.width(); ++x) display[c].At(x, y) = SrgbFromLinear(noisy[c].At(x, y));
      }
    }
  });
  return display;
}

std::array<Plane, 3> LinearColor(const Planes& display, TaskPool* pool) {
  const int width = display[0].width();
  const int height = display[0].height();
  std::array<Plane, 3> linear = {Plane(width, height), Plane(width, height), Plane(width, height)};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < width; ++x) linear[c].At(x, y) = LinearFromSrgb(display[c].At(x, y));
      }
    }
  });
  return linear;
}

}  // namespace lumifold::filter
