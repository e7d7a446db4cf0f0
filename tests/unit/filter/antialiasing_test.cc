#include "filter/edges/antialiasing.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "filter/denoise/denoise.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/edge_films.h"

namespace lumifold::filter {
namespace {

TEST(EdgeAntialiasing, LeavesPixelsAloneThatNothingHits) {
  const LayeredImage film = EdgeFilm();
  LayeredImage edges = EdgeSet();
  const FloatView ids = edges.Get(layers::kObjectId);
  for (int y = 0; y < kHeight; ++y) std::fill_n(ids.Row(y), kSubSamples, 0.0f);
  const auto with = Filtered(film, &edges);
  const auto without = Filtered(film, nullptr);
  for (int y = 0; y < kHeight; ++y) EXPECT_EQ(with[0].At(kEdgeColumn, y), without[0].At(kEdgeColumn, y)) << y;
}

TEST(EdgeAntialiasing, TakesTheMeanOfTheProducts) {
  const LayeredImage edges = EdgeSet();
  constexpr int kFilms = 6;
  double mean = 0;
  for (uint32_t seed = 1; seed <= kFilms; ++seed) {
    const auto with = Filtered(EdgeFilm(seed), &edges);
    for (int y = 0; y < kHeight; ++y)
      mean += static_cast<double>(with[0].At(kEdgeColumn, y)) / (kHeight * kFilms);
  }
  EXPECT_NEAR(mean, 0.505, 0.045);  // three deviations of C in so many pixels
}

TEST(EdgeAntialiasing, IsTheSameForAnyPool) {
  const LayeredImage film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto alone = Filtered(film, &edges);
  ShufflingPool pool(3);
  const auto shuffled = Filtered(film, &edges, &pool);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_TRUE(std::equal(alone[1].Row(y), alone[1].Row(y) + kWidth, shuffled[1].Row(y))) << y;
}

TEST(EdgeAntialiasing, ReadsNoLightWhereASubSampleShowsAMirror) {
  const LayeredImage film = EdgeFilm();
  LayeredImage edges = EdgeSet();
  for (int y = 1; y < kHeight; ++y) edges.Get(layers::kMask).At(5, y) = 0;  // hit, not diffuse, not radiating
  EXPECT_EQ(
      EdgePointsOf(Frame(film, &edges), 1.0f, std::numeric_limits<float>::infinity(), kSigmaNormal).rows,
      std::vector<int>{0});
}

TEST(Stages, WithoutThoseOfEdgesThePictureIsAsWithoutAnEdgeSet) {
  const LayeredImage edge_film = EdgeFilm();
  const LayeredImage edges = EdgeSet();
  const auto without_stages =
      Denoise(edge_film, &edges, nullptr,
              {.off = {"antialiasing", "coverage", "relighting", "regression"}, .watch = {}});
  const auto without_edges = Filtered(edge_film, nullptr);
  for (int y = 0; y < kHeight; ++y)
    EXPECT_EQ(without_stages[0].At(kEdgeColumn, y), without_edges[0].At(kEdgeColumn, y)) << y;
}

}  // namespace
}  // namespace lumifold::filter
