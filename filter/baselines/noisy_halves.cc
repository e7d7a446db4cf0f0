#include "filter/baselines/noisy_halves.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/layers.h"
#include "filter/kernels/box_mean.h"

namespace lumifold::filter {

Halves NoisyHalves(const LayeredImage& film, TaskPool* pool) {
  constexpr float kMost = 1e12f;
  Plane everywhere(film.width(), film.height());
  everywhere.Fill(1.0f);
  Halves halves =
      MakeHalves({film.GetColor(layers::HalfA(layers::kNoisy)), film.GetColor(layers::HalfB(layers::kNoisy)),
                  film.Get(layers::kSamplesA), film.Get(layers::kSamplesB)},
                 everywhere.view(), pool);
  for (Planes* half : {&halves.a, &halves.b}) {
    for (Plane& plane : *half) {
      for (int y = 0; y < plane.height(); ++y) {
        for (int x = 0; x < plane.width(); ++x) plane.At(x, y) = std::clamp(plane.At(x, y), -kMost, kMost);
      }
    }
  }
  return halves;
}

Planes HalfVariance(const Halves& halves, TaskPool* pool) {
  constexpr int kRadius = 3;
  Planes variance = MakePlanes(3, halves.width(), halves.height());
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < halves.height(); ++y) {
      for (int x = 0; x < halves.width(); ++x) {
        const float difference = halves.a[c].At(x, y) - halves.b[c].At(x, y);
        variance[c].At(x, y) = 0.5f * difference * difference;
      }
    }
  }
  return BoxMeans(variance, halves.weight.view(), kRadius, pool);
}

std::array<Plane, 3> FinitePicture(Planes planes, float scale) {
  std::array<Plane, 3> picture;
  for (size_t c = 0; c < 3; ++c) {
    picture[c] = std::move(planes[c]);
    for (int y = 0; y < picture[c].height(); ++y) {
      for (int x = 0; x < picture[c].width(); ++x) {
        float& value = picture[c].At(x, y);
        value = std::isfinite(value) ? value * scale : 0.0f;
      }
    }
  }
  return picture;
}

}  // namespace lumifold::filter
