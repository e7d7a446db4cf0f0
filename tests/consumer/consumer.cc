// Filters a film of its own making with the installed library: a wall of even light, halves that differ by
// noise.
#include <cstdio>
#include <utility>

#include "filter/image/layers.h"
#include "filter/methods.h"
#include "filter/metrics/metrics.h"

namespace {

constexpr int kSize = 64;

void Fill(lumifold::FloatView view, float value) {
  for (int y = 0; y < view.height(); ++y) {
    for (int x = 0; x < view.width(); ++x) view.At(x, y) = value;
  }
}

void FillColor(lumifold::LayeredImage* film, std::string_view layer, float value) {
  for (const lumifold::FloatView& channel : film->AddColor(layer)) Fill(channel, value);
}

/// Even light of 0.5 with alternating errors of +-0.2, opposite signs in neither half's favour.
void FillNoisy(lumifold::LayeredImage* film, std::string_view layer) {
  const lumifold::ColorView mean = film->AddColor(layer);
  const lumifold::ColorView a = film->AddColor(lumifold::layers::HalfA(layer));
  const lumifold::ColorView b = film->AddColor(lumifold::layers::HalfB(layer));
  unsigned state = 1;
  for (int i = 0; i < kSize * kSize; ++i) {
    state = state * 1664525u + 1013904223u;
    const float error_a = (state >> 31) != 0 ? 0.2f : -0.2f;
    const float error_b = ((state >> 30) & 1u) != 0 ? 0.2f : -0.2f;
    for (size_t c = 0; c < 3; ++c) {
      a[c].At(i % kSize, i / kSize) = 0.5f + error_a;
      b[c].At(i % kSize, i / kSize) = 0.5f + error_b;
      mean[c].At(i % kSize, i / kSize) = 0.5f + 0.5f * (error_a + error_b);
    }
  }
}

}  // namespace

int main() {
  namespace layers = lumifold::layers;
  lumifold::LayeredImage film(kSize, kSize);
  FillNoisy(&film, layers::kNoisy);
  FillNoisy(&film, layers::kDirect);
  FillColor(&film, layers::kIndirect, 0);
  FillColor(&film, layers::HalfA(layers::kIndirect), 0);
  FillColor(&film, layers::HalfB(layers::kIndirect), 0);
  FillColor(&film, layers::kAlbedo, 1);
  FillColor(&film, layers::kEmission, 0);
  for (const std::string_view zero : {layers::kNormalX, layers::kNormalY}) Fill(film.Add(zero), 0);
  for (const std::string_view one :
       {layers::kNormalZ, layers::kDistance, layers::kMask, layers::kSamplesA, layers::kSamplesB})
    Fill(film.Add(one), 1);

  const auto pool = lumifold::MakeTaskPool(2);
  const auto picture = lumifold::filter::FilterFilm(film, "default", pool.get());
  if (!picture.ok()) {
    std::fprintf(stderr, "%s\n", picture.status().ToString().c_str());
    return 1;
  }
  lumifold::LayeredImage truth(kSize, kSize);
  FillColor(&truth, layers::kBeauty, 0.5f);
  const lumifold::ConstColorView filtered = {(*picture)[0].view(), (*picture)[1].view(),
                                             (*picture)[2].view()};
  const lumifold::ConstColorView reference = std::as_const(truth).GetColor(layers::kBeauty);
  const double before = lumifold::metrics::Mse255(std::as_const(film).GetColor(layers::kNoisy), reference);
  const double after = lumifold::metrics::Mse255(filtered, reference);
  std::printf("MSE255 %.2f -> %.2f\n", before, after);
  return after < 0.1 * before ? 0 : 1;
}
