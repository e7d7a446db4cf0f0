#include "filter/layers/recombination.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

constexpr int kPixels = 4;
constexpr std::array<std::array<float, 2>, kPixels> kSamplesOfHalves = {{{3, 1}, {1, 3}, {2, 0}, {0, 2}}};
/// nA / n, and nA nB / n^2, of these pixels.
constexpr std::array<float, kPixels> kShareOfA = {0.75f, 0.25f, 1, 0};
constexpr std::array<float, kPixels> kVarianceFactor = {0.1875f, 0.1875f, 0, 0};

/// C = 10, and 1 and 2 in its halves, whose samples are not equally many.
LayeredImage UnequalFilm() {
  LayeredImage film(kPixels, 1);
  for (const std::string& name :
       {std::string(layers::kNoisy), layers::HalfA(layers::kNoisy), layers::HalfB(layers::kNoisy)})
    film.AddColor(name);
  film.Add(layers::kSamplesA);
  film.Add(layers::kSamplesB);
  for (int x = 0; x < kPixels; ++x) {
    film.Get(layers::kSamplesA).At(x, 0) = kSamplesOfHalves[static_cast<size_t>(x)][0];
    film.Get(layers::kSamplesB).At(x, 0) = kSamplesOfHalves[static_cast<size_t>(x)][1];
    for (size_t c = 0; c < 3; ++c) {
      film.GetColor(layers::kNoisy)[c].At(x, 0) = 10;
      film.GetColor(layers::HalfA(layers::kNoisy))[c].At(x, 0) = 1;
      film.GetColor(layers::HalfB(layers::kNoisy))[c].At(x, 0) = 2;
    }
  }
  return film;
}

TEST(Recombination, HalvesCountByTheirSamples) {
  const LayeredImage film = UnequalFilm();
  const Frame frame(film);
  const FrameChange change = {MakePlanes(3, kPixels, 1), MakePlanes(3, kPixels, 1)};
  FrameChange changed = {Clone(change[0]), Clone(change[1])};
  for (size_t c = 0; c < 3; ++c) {
    changed[0][c].Fill(4 + static_cast<float>(c));
    changed[1][c].Fill(8 + static_cast<float>(c));
  }
  Planes returned = MakePlanes(3, kPixels, 1);
  for (Plane& plane : returned) plane.Fill(16);
  const Picture picture = PictureOf(frame, changed, nullptr);
  const Picture same = PictureOf(frame, change, nullptr);
  const Picture deviation = DeviationOf(frame, changed, nullptr);
  const Picture of_returned = DeviationOfReturned(frame, returned, nullptr);
  for (int x = 0; x < kPixels; ++x) {
    const auto i = static_cast<size_t>(x);
    const float deviations = std::sqrt(kVarianceFactor[i]);
    for (size_t c = 0; c < 3; ++c) {
      const float of_mean = kShareOfA[i] * 4 + (1 - kShareOfA[i]) * 8 + static_cast<float>(c);
      EXPECT_FLOAT_EQ(picture[c].At(x, 0), 10 + of_mean) << x;
      EXPECT_EQ(same[c].At(x, 0), 10) << x;
      EXPECT_FLOAT_EQ(deviation[c].At(x, 0), deviations * (1 + 4 - 2 - 8)) << x;
      EXPECT_FLOAT_EQ(of_returned[c].At(x, 0), deviations * 16) << x;
    }
    EXPECT_EQ(frame.samples.HasBoth(x, 0), kVarianceFactor[i] > 0) << x;
    EXPECT_FLOAT_EQ(frame.samples.VarianceFactor(x, 0, 2), 2 * kVarianceFactor[i]) << x;
  }
}

}  // namespace
}  // namespace lumifold::filter
