#include "server/film/unit_layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_unit.h"

namespace lumifold::film {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr Rect kRect = {8, 0, 16, 4};

v1::PixelLayout Layout(v1::UnitKind kind) {
  return rpc::LayoutOf(RandomUnit({0, 0, 0, kind}, kRect, {0, 4}, 1));
}

TEST(UnitLayout, NamesFourHalvedLayersAndTheRest) {
  EXPECT_THAT(PassChannels(), SizeIs(4 * 2 * 3 + 3 + 3 + 2));
  EXPECT_THAT(PassChannels(), Contains("reflection1_b.G"));
  EXPECT_THAT(PassChannels(), Contains("samples_a.Y"));
  EXPECT_THAT(GeometryChannels(), SizeIs(8));
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
              HasSubstr("33 channels"));
  EXPECT_FALSE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, Layout(v1::UNIT_KIND_GEOMETRY)).ok());
}

}  // namespace
}  // namespace lumifold::film
