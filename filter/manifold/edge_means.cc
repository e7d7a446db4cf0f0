#include "filter/manifold/edge_means.h"

#include <cmath>

#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/manifold/edge_pixels.h"

namespace lumifold::filter {
namespace {

float MeanOverSubSamples(const ConstFloatView& values, int row) {
  float sum = 0;
  for (int sample = 0; sample < kSubSamples; ++sample) sum += values.At(sample, row);
  return sum / kSubSamples;
}

/// How far the sub-samples are believed beside n samples. Error of evenly spread samples falls nearly as 1/n.
float ShareOfSubSamples(float n) {
  constexpr float kOwn = kSubSamples * kSubSamples;
  return kOwn / (kOwn + n * n);
}

}  // namespace

Planes EdgeMeansChange(const LayeredImage& film, const LayeredImage* edges, const Planes& direct,
                       const Planes& indirect) {
  Planes change = MakePlanes(3, film.width(), film.height());
  if (edges == nullptr || edges->channels().empty()) return change;
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  const ConstColorView emission = film.GetColor(layers::kEmission);
  const ConstColorView sub_albedo = edges->GetColor(layers::kAlbedo);
  const ConstColorView sub_emission = edges->GetColor(layers::kEmission);
  ForEachEdgePixel(edges, film.bounds(), [&](int row, int x, int y) {
    const float share = ShareOfSubSamples(n_a.At(x, y) + n_b.At(x, y));
    for (size_t c = 0; c < 3; ++c) {
      const float light = direct[c].At(x, y) + indirect[c].At(x, y);
      const float off = light * (MeanOverSubSamples(sub_albedo[c], row) - albedo[c].At(x, y)) +
                        MeanOverSubSamples(sub_emission[c], row) - emission[c].At(x, y);
      if (std::isfinite(off)) change[c].At(x, y) = share * off;
    }
  });
  return change;
}

}  // namespace lumifold::filter
