#include "filter/image/level_mask.h"

#include <string>

#include "filter/image/layers.h"
#include "filter/image/planes.h"

namespace lumifold {

Plane LevelMask(const LayeredImage& film) {
  Plane mask(film.width(), film.height());
  for (const layers::Branch branch : {layers::Branch::kReflection, layers::Branch::kTransmission}) {
    const std::string name = layers::OfLevel({branch, 1}, layers::kDistance);
    if (!film.Has(name)) continue;
    const ConstFloatView distance = film.Get(name);
    ForEachPixel(film.width(), film.height(), [&](int x, int y) {
      if (distance.At(x, y) > 0) mask.At(x, y) = 1;
    });
  }
  return mask;
}

}  // namespace lumifold
