#include "filter/baselines/display_color.h"

#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

Planes DisplayColor(const LayeredImage& film, TaskPool* pool) {
  const ConstColorView noisy = film.GetColor(layers::kNoisy);
  Planes display = MakePlanes(3, film.width(), film.height());
  ForEachPixel(pool, film.width(), film.height(), [&](int x, int y) {
    for (size_t c = 0; c < 3; ++c) display[c].At(x, y) = SrgbFromLinear(noisy[c].At(x, y));
  });
  return display;
}

Picture LinearColor(const Planes& display, TaskPool* pool) {
  const int width = display[0].width();
  const int height = display[0].height();
  Picture linear = MakePicture(width, height);
  ForEachPixel(pool, width, height, [&](int x, int y) {
    for (size_t c = 0; c < 3; ++c) linear[c].At(x, y) = LinearFromSrgb(display[c].At(x, y));
  });
  return linear;
}

}  // namespace lumifold::filter
