#include "server/film/unit_layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/random_unit.h"

namespace lumifold::film {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr Rect kRect = {8, 0, 16, 4};

v1::PixelLayout Layout(v1::UnitKind kind, int32_t tile = 0) {
  return rpc::LayoutOf(RandomUnit({0, tile, 0, kind}, kRect, {0, 4}, 1).pixels);
}

TEST(UnitLayout, NamesFourHalvedLayersAndTheRest) {
  EXPECT_THAT(PassChannels(), SizeIs(4 * 2 * 3 + 3 * 3 + 2));
  EXPECT_THAT(PassChannels(), Contains("glossy_b.G"));
  EXPECT_THAT(PassChannels(), Contains("samples_a.Y"));
  EXPECT_THAT(GeometryChannels(), SizeIs(9));
}

TEST(UnitLayout, TakesALevelWholeOrNotAtAll) {
  for (const v1::UnitKind kind : {v1::UNIT_KIND_PASS, v1::UNIT_KIND_GEOMETRY}) {
    v1::PixelLayout layout = Layout(kind, 1);
    EXPECT_TRUE(CheckUnitLayout(kind, kRect, layout).ok());
    EXPECT_TRUE(rpc::CheckLayout(layout, UnitLimits(kRect)).ok());
    layout.mutable_channels()->RemoveLast();
    EXPECT_THAT(std::string(CheckUnitLayout(kind, kRect, layout).message()), HasSubstr("reflection1_"));
  }
}

TEST(UnitLayout, AnEdgeSetMustBeOfItsTile) {
  const LayeredImage good = RandomUnit({0, 0, 0, v1::UNIT_KIND_GEOMETRY}, kRect, {}, 1).edges;
  EXPECT_TRUE(CheckEdges(kRect, good).ok());
  EXPECT_TRUE(CheckEdges(kRect, LayeredImage()).ok());
  const absl::Status elsewhere = CheckEdges({0, 0, 8, 4}, good);
  EXPECT_EQ(elsewhere.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(elsewhere.message()), HasSubstr("pixel 15,0 of row 0"));
  for (const float bad : {-1.0f, 99.0f, NAN, 0.0f}) {  // 0 is in the tile, but not after the previous row
    LayeredImage edges = RandomUnit({0, 0, 0, v1::UNIT_KIND_GEOMETRY}, kRect, {}, 1).edges;
    edges.Get(layers::kPixelY).At(0, 1) = bad;
    edges.Get(layers::kPixelX).At(0, 1) = 8;
    EXPECT_FALSE(CheckEdges(kRect, edges).ok()) << bad;
  }
  LayeredImage without(kSubSamples, 1);
  without.Add(layers::kPixelX);
  EXPECT_THAT(std::string(CheckEdges(kRect, without).message()), HasSubstr("pixel.Y"));
}

TEST(UnitLayout, AcceptsChannelsInAnyOrder) {
  v1::PixelLayout layout = Layout(v1::UNIT_KIND_PASS);
  layout.mutable_channels()->SwapElements(0, 5);
  EXPECT_TRUE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout).ok());
  EXPECT_TRUE(CheckUnitLayout(v1::UNIT_KIND_GEOMETRY, kRect, Layout(v1::UNIT_KIND_GEOMETRY)).ok());
}

TEST(UnitLayout, NamesWhatIsWrong) {
  v1::PixelLayout layout = Layout(v1::UNIT_KIND_PASS);
  layout.set_width(9);
  EXPECT_THAT(std::string(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout).message()),
              HasSubstr("size 9x4"));
  layout = Layout(v1::UNIT_KIND_PASS);
  layout.set_channels(0, "other.R");
  EXPECT_THAT(std::string(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout).message()),
              HasSubstr("noisy_a.R"));
  layout = Layout(v1::UNIT_KIND_PASS);
  layout.add_channels("other.R");
  EXPECT_THAT(std::string(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout).message()),
              HasSubstr("36 channels"));
  EXPECT_FALSE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, Layout(v1::UNIT_KIND_GEOMETRY)).ok());
}

}  // namespace
}  // namespace lumifold::film
