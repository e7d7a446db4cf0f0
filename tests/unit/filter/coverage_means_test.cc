#include "filter/edges/coverage_means.h"

#include <gtest/gtest.h>

#include <string_view>

#include "tests/unit/filter/edge_films.h"

namespace lumifold::filter {
namespace {

// A lamp of radiance 8 that covers half of an edge pixel, which few samples hit by chance.

TEST(CoverageChange, TakeOutTheNoiseOfWhereFewSamplesFell) {
  LayeredImage film = WallFilm();  // two samples a pixel
  LayeredImage edges = EdgeSet();
  Set(film.GetColor(layers::kEmission), kEdgeColumn, 5, 8.0f);  // both hit
  Set(film.GetColor(layers::kAlbedo), kEdgeColumn, 5, 0.0f);
  for (int j = 0; j < kSubSamples; ++j) {
    const bool is_lamp = j % 4 < 2;
    Set(edges.GetColor(layers::kEmission), j, 5, is_lamp ? 8.0f : 0.0f);
    Set(edges.GetColor(layers::kAlbedo), j, 5, is_lamp ? 0.0f : 0.6f);
  }
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (Plane& plane : light) plane.Fill(1.5f);
  const Planes change = CoverageChange(Frame(film, &edges), light, nullptr);
  // Two samples beside 256 / 2 that say nothing, and no other pixel alike; then own ones once more.
  const float share = (1 - 2.0f / (2.0f + 128.0f)) * (1 - 4.0f / (4.0f + 1024.0f));
  EXPECT_NEAR(change[1].At(kEdgeColumn, 5), share * ((4.0f - 8.0f) + 1.5f * 0.3f), 1e-5f);
  EXPECT_EQ(change[1].At(kEdgeColumn + 1, 5), 0);

  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
    film.Get(count).At(kEdgeColumn, 5) = 2048;
  EXPECT_NEAR(CoverageChange(Frame(film, &edges), light, nullptr)[1].At(kEdgeColumn, 5), 0, 1e-4f);
  EXPECT_EQ(CoverageChange(Frame(film, nullptr), light, nullptr)[1].At(kEdgeColumn, 5), 0);
}

// A lamp of radiance 8 left of the edge, which covers a twentieth of the pixels there: so little that all
// sub-samples miss it, and of 16 samples four fall on it in every fifth pixel.

TEST(CoverageChange, FindWhatSubSamplesMissByThePixelsAlike) {
  LayeredImage film = WallFilm();
  LayeredImage edges = EdgeSet();
  const ColorView emission = film.GetColor(layers::kEmission);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kEdgeColumn; ++x) Set(emission, x, y, 8.0f);
    Set(emission, kEdgeColumn, y, y % 5 == 0 ? 2.0f : 0.0f);
    for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB})
      film.Get(count).At(kEdgeColumn, y) = 8;
    for (int j = 0; j < kSubSamples; ++j) Set(edges.GetColor(layers::kAlbedo), j, y, 0.0f);
  }
  const Planes none = MakePlanes(3, kWidth, kHeight);
  const Planes change = CoverageChange(Frame(film, &edges), none, nullptr);
  for (int y = 16; y < kHeight - 16; ++y) {
    const float steady = emission[1].At(kEdgeColumn, y) + change[1].At(kEdgeColumn, y);
    EXPECT_GT(steady, 0.25f) << y;  // of .4; without the pixels alike: 0 or 1
    EXPECT_LT(steady, 0.8f) << y;
  }
}

TEST(CoverageChange, LeaveTWhereAMirrorTakesPartOfThePixel) {
  constexpr Rect kMirrored = {kEdgeColumn, 0, kEdgeColumn + 1, 6};
  const LayeredImage film = ShowingMirror(WallFilm(), kMirrored);
  LayeredImage edges = EdgeSet();
  for (const int row : {5, 6}) {
    for (int j = 0; j < kSubSamples; ++j) {
      Set(edges.GetColor(layers::kAlbedo), j, row, 0.6f);
      Set(edges.GetColor(layers::kEmission), j, row, 0.0f);
    }
  }
  Planes light = MakePlanes(3, kWidth, kHeight);
  for (Plane& plane : light) plane.Fill(1.5f);
  const Planes change = CoverageChange(Frame(film, &edges), light, nullptr);
  EXPECT_EQ(change[1].At(kEdgeColumn, 5), 0);
  EXPECT_GT(change[1].At(kEdgeColumn, 6), 0.8f);  // .6 of 1.5, which the own samples did not see
}

}  // namespace
}  // namespace lumifold::filter
