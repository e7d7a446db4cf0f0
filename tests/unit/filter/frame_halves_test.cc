#include "filter/denoise/frame_halves.h"

#include <gtest/gtest.h>

#include <random>

#include "filter/image/layers.h"
#include "tests/unit/filter/synthetic_film.h"

namespace lumifold::filter {
namespace {

constexpr int kRareSide = 128;
constexpr float kRareDark = 0.2f;  // what most samples see
constexpr double kRarePart = 0.1;  // of the pixels of a half that see the rare light
constexpr float kRareBright = 10;  // the mean of that

/// A film whose halves are of rare light alone, the same everywhere.
LayeredImage RareLight() {
  LayeredImage film = MakeSyntheticFilm(kRareSide, kRareSide, 0, 1).film;
  std::mt19937 random(5);
  std::bernoulli_distribution sees(kRarePart);
  std::exponential_distribution<float> light(1 / kRareBright);
  ForEachPixel(kRareSide, kRareSide, [&](int x, int y) {
    const float a = kRareDark + (sees(random) ? light(random) : 0);
    const float b = kRareDark + (sees(random) ? light(random) : 0);
    for (size_t c = 0; c < 3; ++c) {
      film.GetColor(layers::HalfA(layers::kNoisy))[c].At(x, y) = a;
      film.GetColor(layers::HalfB(layers::kNoisy))[c].At(x, y) = b;
      film.GetColor(layers::kNoisy)[c].At(x, y) = 0.5f * (a + b);
      film.GetColor(layers::kEmission)[c].At(x, y) = 0;
    }
    film.Get(layers::kSamplesA).At(x, y) = film.Get(layers::kSamplesB).At(x, y) = 2;
  });
  return film;
}

TEST(ChooseChange, PutsNoSpecksOfRareLightBackIntoATruePicture) {
  const LayeredImage film = RareLight();
  const Frame frame(film);
  const float truth = kRareDark + static_cast<float>(kRarePart) * kRareBright;
  FrameChange change = NoChange(frame);
  for (size_t h = 0; h < 2; ++h) {
    const ConstColorView& half = h == 0 ? frame.combined.a : frame.combined.b;
    for (size_t c = 0; c < 3; ++c)
      ForEachPixel(kRareSide, kRareSide,
                   [&](int x, int y) { change[h][c].At(x, y) = truth - half[c].At(x, y); });
  }
  const Plane share = ChooseChange(frame, Plane(kRareSide, kRareSide), {}, {}, nullptr, &change);
  double mean = 0;
  ForEachPixel(kRareSide, kRareSide,
               [&](int x, int y) { mean += static_cast<double>(share.At(x, y)) / (kRareSide * kRareSide); });
  EXPECT_LT(mean, 0.01);
}

}  // namespace
}  // namespace lumifold::filter
