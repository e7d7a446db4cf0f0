#include "filter/baselines/noisy_halves.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/kernels/box_mean.h"

namespace lumifold::filter {

Halves NoisyHalves(const LayeredImage& film, TaskPool* pool) {
  constexpr float kMost = 1e12f;
  Plane everywhere = MakePlane(film.width(), film.height(), 1.0f);
  Halves halves =
      MakeHalves({film.GetColor(layers::HalfA(layers::kNoisy)), film.GetColor(layers::HalfB(layers::kNoisy)),
                  film.Get(layers::kSamplesA), film.Get(layers::kSamplesB)},
                 everywhere.view(), pool);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) {
      ForEachPixel(plane.width(), plane.height(),
                   [&](int x, int y) { plane.At(x, y) = std::clamp(plane.At(x, y), -kMost, kMost); });
    }
  }
  return halves;
}

Planes HalfVariance(const Halves& halves, TaskPool* pool) {
  constexpr int kRadius = 2;
  Planes variance = MakePlanes(3, halves.width(), halves.height());
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(halves.width(), halves.height(), [&](int x, int y) {
      const float difference = halves.a[c].At(x, y) - halves.b[c].At(x, y);
      variance[c].At(x, y) = 0.5f * difference * difference;
    });
  }
  return BoxMeans(variance, halves.weight.view(), kRadius, pool);
}

Picture FinitePicture(Planes planes, float scale) {
  Picture picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = std::move(planes[c]);
    ForEachPixel(picture[c].width(), picture[c].height(), [&](int x, int y) {
      float& value = picture[c].At(x, y);
      value = scale * UsableOr0(value, std::numeric_limits<float>::max());
    });
  }
  return picture;
}

}  // namespace lumifold::filter
