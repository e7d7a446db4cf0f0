#include "server/job/tile_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <vector>

namespace lumifold::job {
namespace {

using ::testing::ElementsAre;

v1::JobSpec Spec(int width, int height, int tile_size, int samples, int pass_samples) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(width);
  spec.set_height(height);
  spec.set_tile_size(tile_size);
  spec.set_samples_per_pixel(samples);
  spec.set_pass_samples(pass_samples);
  return spec;
}

TEST(TileGrid, CoversEveryPixelOnce) {
  for (const int width : {1, 31, 32, 33, 100}) {
    for (const int height : {1, 32, 65}) {
      const TileGrid grid(width, height, 32);
      std::vector<int> covered(static_cast<size_t>(width * height));
      for (int tile = 0; tile < grid.count(); ++tile) {
        const Rect rect = grid.RectOf(tile);
        ASSERT_FALSE(rect.IsEmpty());
        for (int y = rect.y0; y < rect.y1; ++y) {
          for (int x = rect.x0; x < rect.x1; ++x)
            ++covered.at(static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x));
        }
      }
      for (const int count : covered) EXPECT_EQ(count, 1);
    }
  }
}

TEST(TileGrid, TilesInARectangleAreThoseThatMeetIt) {
  const TileGrid grid(70, 40, 16);
  for (const Rect& rect : {Rect{0, 0, 70, 40}, Rect{0, 0, 1, 1}, Rect{16, 16, 32, 32}, Rect{15, 31, 33, 33},
                           Rect{69, 39, 70, 40}}) {
    std::vector<int32_t> expected;
    for (int32_t tile = 0; tile < grid.count(); ++tile) {
      if (!Intersect(grid.RectOf(tile), rect).IsEmpty()) expected.push_back(tile);
    }
    EXPECT_EQ(grid.TilesIn(rect), expected);
  }
}

TEST(TileGrid, NumbersRowByRow) {
  const TileGrid grid(70, 40, 32);
  EXPECT_EQ(grid.count(), 6);
  EXPECT_EQ(grid.RectOf(2), (Rect{64, 0, 70, 32}));
  EXPECT_EQ(grid.RectOf(3), (Rect{0, 32, 32, 40}));
}

TEST(TileGrid, RanksAreASpiralFromTheCentre) {
  const TileGrid grid(5 * 8, 3 * 8, 8);
  std::vector<int> tiles;
  tiles.reserve(static_cast<size_t>(grid.count()));
  for (int rank = 0; rank < grid.count(); ++rank) tiles.push_back(grid.TileOfRank(rank));
  EXPECT_EQ(tiles, (std::vector<int>{7, 1, 2, 3, 8, 13, 12, 11, 6, 4, 9, 14, 10, 5, 0}));
}

TEST(TileGrid, RanksAndTilesAreInverseForAnyShape) {
  for (int columns = 1; columns <= 9; ++columns) {
    for (int rows = 1; rows <= 9; ++rows) {
      const TileGrid grid(columns * 8, rows * 8, 8);
      int last_distance = 0;
      for (int rank = 0; rank < grid.count(); ++rank) {
        const int tile = grid.TileOfRank(rank);
        ASSERT_EQ(grid.RankOf(tile), rank) << columns << "x" << rows;
        const int distance =
            std::max(std::abs(tile % columns - (columns - 1) / 2), std::abs(tile / columns - (rows - 1) / 2));
        EXPECT_GE(distance, last_distance);
        last_distance = distance;
      }
    }
  }
  const TileGrid large(16384, 16384, 8);
  for (const int tile : {0, 1, 2047, 2048, 1'000'000, large.count() - 1})
    EXPECT_EQ(large.TileOfRank(large.RankOf(tile)), tile);
}

TEST(FrameUnits, PassesCoverEverySampleOnce) {
  const FrameUnits units(Spec(10, 10, 8, 100, 64));
  EXPECT_EQ(units.pass_count(), 2);
  EXPECT_EQ(units.SamplesOf({0, 0, 0, v1::UNIT_KIND_PASS}), (SampleRange{0, 64}));
  EXPECT_EQ(units.SamplesOf({0, 0, 1, v1::UNIT_KIND_PASS}), (SampleRange{64, 100}));
  EXPECT_EQ(units.SamplesOf({0, 0, 0, v1::UNIT_KIND_GEOMETRY}), (SampleRange{0, 0}));
}

TEST(FrameUnits, AFirstPassIsTakenOutOfTheNext) {
  const auto ranges = [](int samples, int pass_samples, int first) {
    v1::JobSpec spec = Spec(8, 8, 8, samples, pass_samples);
    spec.set_first_pass_samples(first);
    const FrameUnits units(spec);
    std::vector<SampleRange> all;
    all.reserve(static_cast<size_t>(units.pass_count()));
    for (int32_t pass = 0; pass < units.pass_count(); ++pass)
      all.push_back(units.SamplesOf({0, 0, pass, v1::UNIT_KIND_PASS}));
    return all;
  };
  EXPECT_THAT(ranges(100, 64, 2), ElementsAre(SampleRange{0, 2}, SampleRange{2, 64}, SampleRange{64, 100}));
  EXPECT_THAT(ranges(64, 64, 2), ElementsAre(SampleRange{0, 2}, SampleRange{2, 64}));
  EXPECT_THAT(ranges(3, 64, 2), ElementsAre(SampleRange{0, 2}, SampleRange{2, 3}));
  EXPECT_THAT(ranges(2, 64, 2), ElementsAre(SampleRange{0, 2})) << "there is nothing else";
  EXPECT_THAT(ranges(4, 2, 2), ElementsAre(SampleRange{0, 2}, SampleRange{2, 4}))
      << "all passes are as short";
}

TEST(FrameUnits, NumbersAndKeysAreInverse) {
  v1::JobSpec spec = Spec(70, 40, 32, 100, 16);
  for (const int first : {0, 2}) {
    spec.set_first_pass_samples(first);
    const FrameUnits units(spec);
    ASSERT_EQ(units.count(), 6 * (first > 0 ? 9 : 8));
    std::set<UnitKey> seen;
    for (int64_t number = 0; number < units.count(); ++number) {
      const UnitKey key = units.KeyOf(3, number);
      EXPECT_EQ(key.frame, 3);
      EXPECT_EQ(key.kind, units.KindOf(number));
      EXPECT_EQ(units.NumberOf(key), number);
      EXPECT_TRUE(seen.insert(key).second);
    }
  }
}

TEST(FrameUnits, TilesAreSeenOneAfterAnotherThenComePasses) {
  const FrameUnits units(Spec(64, 32, 32, 64, 32));
  EXPECT_EQ(units.KeyOf(0, 0), (UnitKey{0, 0, 0, v1::UNIT_KIND_GEOMETRY}));
  EXPECT_EQ(units.KeyOf(0, 1), (UnitKey{0, 0, 0, v1::UNIT_KIND_PASS}));
  EXPECT_EQ(units.KeyOf(0, 2), (UnitKey{0, 1, 0, v1::UNIT_KIND_GEOMETRY}));
  EXPECT_EQ(units.KeyOf(0, 3), (UnitKey{0, 1, 0, v1::UNIT_KIND_PASS}));
  EXPECT_EQ(units.KeyOf(0, 4), (UnitKey{0, 0, 1, v1::UNIT_KIND_PASS}));
}

TEST(FrameUnits, ForeignKeysHaveNoNumber) {
  const FrameUnits units(Spec(64, 32, 32, 64, 32));
  EXPECT_FALSE(units.NumberOf({0, 2, 0, v1::UNIT_KIND_PASS}).has_value());
  EXPECT_FALSE(units.NumberOf({0, -1, 0, v1::UNIT_KIND_PASS}).has_value());
  EXPECT_FALSE(units.NumberOf({0, 0, 2, v1::UNIT_KIND_PASS}).has_value());
  EXPECT_FALSE(units.NumberOf({0, 0, -1, v1::UNIT_KIND_PASS}).has_value());
  EXPECT_FALSE(units.NumberOf({0, 0, 1, v1::UNIT_KIND_GEOMETRY}).has_value());
  EXPECT_FALSE(units.NumberOf({0, 0, 0, v1::UNIT_KIND_UNSPECIFIED}).has_value());
}

TEST(FrameUnits, CountsCameraSamplesOfSmallerTiles) {
  const FrameUnits units(Spec(40, 8, 32, 10, 4));
  EXPECT_EQ(units.CameraSamplesOf({0, 0, 0, v1::UNIT_KIND_PASS}), 32 * 8 * 4);
  EXPECT_EQ(units.CameraSamplesOf({0, 1, 2, v1::UNIT_KIND_PASS}), 8 * 8 * 2);
  EXPECT_EQ(units.CameraSamplesOf({0, 1, 0, v1::UNIT_KIND_GEOMETRY}), 0);
}

}  // namespace
}  // namespace lumifold::job
