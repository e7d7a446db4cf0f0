#include "server/film/unit_layout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/algorithm/container.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/made_up_plan.h"
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

TEST(UnitLayout, ALensPutsWhatItMakesVaryIntoHalves) {
  v1::JobSpec spec;
  *spec.mutable_plan() = MadeUpPlan();
  EXPECT_EQ(PassChannels(ModelOf(spec)), PassChannels());
  EXPECT_EQ(GeometryChannels(ModelOf(spec)), GeometryChannels());
  spec.mutable_lens()->set_f_stop(2);
  const UnitModel model = ModelOf(spec);
  EXPECT_THAT(PassChannels(model), SizeIs(4 * 2 * 3 + 3 * 2 * 3 + 2));
  EXPECT_THAT(PassChannels(model), Contains("albedo_b.R"));
  EXPECT_THAT(PassChannels(model), ::testing::Not(Contains("albedo.R")));
  EXPECT_THAT(GeometryChannels(model), Contains("blur.Y"));
  for (const v1::UnitKind kind : {v1::UNIT_KIND_PASS, v1::UNIT_KIND_GEOMETRY}) {
    constexpr int32_t kWithLevel = 1;
    const v1::PixelLayout layout =
        rpc::LayoutOf(RandomUnit({0, kWithLevel, 0, kind}, kRect, {0, 4}, 1, model).pixels);
    EXPECT_TRUE(CheckUnitLayout(kind, kRect, layout, model).ok());
    EXPECT_FALSE(CheckUnitLayout(kind, kRect, layout, ModelOf({})).ok());
    EXPECT_FALSE(CheckUnitLayout(kind, kRect, Layout(kind, kWithLevel), model).ok());
  }
}

TEST(UnitLayout, ADecisionAgainstALayerTakesItsChannelsAway) {
  const std::vector<std::pair<std::string_view, std::vector<std::string_view>>> layers_of = {
      {decisions::kDirect, {layers::kDirect}},
      {decisions::kIndirect, {layers::kIndirect}},
      {decisions::kAlbedo, {layers::kAlbedo}},
      {decisions::kEmission, {layers::kEmission}},
      {decisions::kGlossy, {layers::kGlossy, layers::kGlossyAlbedo}}};
  for (const auto& [decision, layers_without] : layers_of) {
    v1::JobSpec spec;
    *spec.mutable_plan() = MadeUpPlan();
    for (v1::PlanDecision& made : *spec.mutable_plan()->mutable_decisions()) {
      if (made.name() == decision) made.set_value(0);
    }
    const std::vector<std::string> left = PassChannels(ModelOf(spec));
    for (const std::string& channel : PassChannels()) {
      const bool is_away =
          std::any_of(layers_without.begin(), layers_without.end(), [&](std::string_view layer) {
            const size_t end = layer.size();  // "glossy_a.R" is of "glossy", "glossy_albedo.R" is not
            return channel.starts_with(layer) && (channel[end] == '.' || channel.substr(end + 2, 1) == ".");
          });
      EXPECT_EQ(absl::c_linear_search(left, channel), !is_away) << decision << " " << channel;
    }
  }
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

constexpr Rect kWholeTile = {0, 0, 32, 32};

/// Four fragments in each pixel of a tile. Most of its planes are constant, one is compressed, and one has
/// whole numbers.
LayeredImage LongList() {
  const int rows = 4 * kWholeTile.width() * kWholeTile.height();
  LayeredImage list = LayeredImage::List(1, rows);
  for (const std::string& channel : layers::FragmentChannels()) list.Add(channel);
  for (int row = 0; row < rows; ++row) {
    const int pixel = row / 4;
    const int y = pixel / kWholeTile.width();
    list.Get(layers::kPixelX).At(0, row) = static_cast<float>(pixel % kWholeTile.width());
    list.Get(layers::kPixelY).At(0, row) = static_cast<float>(y);
    list.Get(layers::kSurface).At(0, row) = static_cast<float>(1 + row % 4);
    list.Get(layers::kDistance).At(0, row) = 2.0f + 1e-4f * static_cast<float>(row);
    list.Get(layers::kSamplesA).At(0, row) = 1;
  }
  return list;
}

TEST(UnitLayout, LongListsAreCheckedAlikeHoweverTheyAreEncoded) {
  LayeredImage list = LongList();
  rpc::RunningChecksum in_memory, received, expected;
  ASSERT_TRUE(CheckFragments(kWholeTile, {}, list, &in_memory).ok());
  ASSERT_TRUE(CheckFragments(kWholeTile, {}, Received(list), &received).ok());
  expected.Add(rpc::BytesFromImage(list));
  EXPECT_EQ(in_memory.Value(), expected.Value());
  EXPECT_EQ(received.Value(), expected.Value());
  list.Get(layers::kDistance).At(0, 2500) = NAN;
  for (const absl::Status& status :
       {CheckFragments(kWholeTile, {}, list), CheckFragments(kWholeTile, {}, Received(list))}) {
    EXPECT_THAT(std::string(status.message()), HasSubstr("distance.Z of row 2500 is nan"));
  }
}

TEST(UnitLayout, FragmentsAreSurfacesOfPixelsOfTheirTile) {
  const auto fragments = [] { return RandomUnit({0, 0, 0, v1::UNIT_KIND_PASS}, kRect, {0, 4}, 1).fragments; };
  ASSERT_EQ(fragments().height(), 4);
  EXPECT_TRUE(CheckFragments(kRect, {}, fragments()).ok()) << CheckFragments(kRect, {}, fragments());
  EXPECT_TRUE(CheckFragments(kRect, {}, LayeredImage()).ok());
  EXPECT_THAT(std::string(CheckFragments({0, 0, 8, 4}, {}, fragments()).message()),
              HasSubstr("row 0 is surface 7 of the pixel 15,0"));
  struct Case {
    const char* channel;
    int row;
    float value;
    const char* message;  // null: valid
  };
  const std::vector<Case> cases = {
      {"direct_a.R", 2, -1.0f, nullptr},
      {"direct_a.R", 2, NAN, "fragments: direct_a.R of row 2 is nan, not finite"},
      {"pixel.X", 1, 16, "row 1 is surface"},
      {"pixel.Y", 0, -1, "row 0 is surface"},
      {"pixel.Y", 3, 0, "row 3 is surface"},  // in the tile, but not after the row above
      {"pixel.X", 0, 15.5f, "row 0 is surface"},
      {"surface.Y", 1, 7, "row 1 is surface 7"},
      {"surface.Y", 1, 3, "row 1 is surface 3"},
      {"surface.Y", 1, 8, nullptr},
      {"surface.Y", 0, 0, "row 0 is surface 0"},
      {"surface.Y", 0, 1.5f, "row 0 is surface 1.5"},
      {"surface.Y", 1, 0x1p24f, "row 1 is surface 1.67772e+07"},
      {"samples_a.Y", 2, 0, nullptr},
      {"samples_a.Y", 2, -1, "row 2 has -1 and 1 samples"},
      {"samples_b.Y", 2, 0.5f, "row 2 has 1 and 0.5 samples"},
  };
  for (const Case& c : cases) {
    LayeredImage changed = fragments();
    changed.Get(c.channel).At(0, c.row) = c.value;
    const absl::Status status = CheckFragments(kRect, {}, changed);
    EXPECT_EQ(status.ok(), c.message == nullptr) << c.channel << ' ' << c.value << ' ' << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.message == nullptr ? "" : c.message));
  }
  LayeredImage none = fragments();
  for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB}) none.Get(count).At(0, 3) = 0;
  EXPECT_THAT(std::string(CheckFragments(kRect, {}, none).message()), HasSubstr("row 3 has 0 and 0 samples"));
}

TEST(UnitLayout, APixelHasAtMostEightFragmentsInAPass) {
  for (const int rows : {kMaxFragments, kMaxFragments + 1}) {
    LayeredImage fragments(1, rows);
    for (const std::string& name : layers::FragmentChannels()) fragments.Add(name).At(0, 0) = 1;
    for (int row = 0; row < rows; ++row) {
      fragments.Get(layers::kPixelX).At(0, row) = 9;
      fragments.Get(layers::kPixelY).At(0, row) = 1;
      fragments.Get(layers::kSurface).At(0, row) = static_cast<float>(row + 1);
      fragments.Get(layers::kSamplesB).At(0, row) = 1;
    }
    EXPECT_EQ(CheckFragments(kRect, {}, fragments).ok(), rows == kMaxFragments);
    EXPECT_TRUE(rpc::CheckLayout(rpc::LayoutOf(fragments), ListLimits(v1::UNIT_KIND_PASS, kRect)).ok());
    EXPECT_FALSE(
        rpc::CheckLayout(rpc::LayoutOf(fragments), ListLimits(v1::UNIT_KIND_PASS, {0, 0, 1, 1})).ok() &&
        rows > kMaxFragments);
  }
}

TEST(UnitLayout, AnEdgeSetHasFiniteValuesAndOnePixelInEachRow) {
  const LayeredImage good = RandomUnit({0, 0, 0, v1::UNIT_KIND_GEOMETRY}, kRect, {}, 1).edges;
  struct Case {
    const char* channel;
    float value;
    const char* message;
  };
  for (const Case& c : {Case{"N.X", NAN, "edge set: N.X of row 1 is nan"},
                        {"distance.Z", INFINITY, "edge set: distance.Z of row 1 is inf"},
                        {"pixel.X", 9, "of row 1 is outside the tile, out of order or ambiguous"}}) {
    LayeredImage edges = good.Crop(good.bounds());
    edges.Get(c.channel).At(7, 1) = c.value;
    EXPECT_THAT(std::string(CheckEdges(kRect, edges).message()), HasSubstr(c.message));
  }
}

TEST(UnitLayout, EveryValueIsCheckedAndNamed) {
  struct Case {
    v1::UnitKind kind;
    const char* channel;
    float value;
    const char* message;  // null: valid
  };
  constexpr v1::UnitKind kPass = v1::UNIT_KIND_PASS;
  constexpr v1::UnitKind kGeometry = v1::UNIT_KIND_GEOMETRY;
  constexpr SampleRange kSamples = {4, 9};  // even indices 4, 6, 8; odd indices 5, 7
  const std::vector<Case> cases = {
      {kPass, "noisy_a.R", -1.0f, nullptr},
      {kPass, "noisy_a.R", NAN, "unit: noisy_a.R is nan at 15,3, not finite"},
      {kPass, "glossy_albedo.B", INFINITY, "unit: glossy_albedo.B is inf at 15,3, not finite"},
      {kPass, "reflection1_direct_b.G", -INFINITY,
       "unit: reflection1_direct_b.G is -inf at 15,3, not finite"},
      {kPass, "samples_a.Y", NAN, "samples_a.Y is nan"},
      {kPass, "samples_a.Y", -1, "samples_a.Y is -1 at 15,3, not a whole number from 0 to 3"},
      {kPass, "samples_a.Y", 4, "samples_a.Y is 4 at 15,3, not a whole number from 0 to 3"},
      {kPass, "samples_b.Y", 3, "samples_b.Y is 3 at 15,3, not a whole number from 0 to 2"},
      {kPass, "samples_b.Y", 1.5f, "samples_b.Y is 1.5"},
      {kPass, "samples_b.Y", 1, "unit: has 159 samples and 0 bad ones, but its pass has 160"},
      {kPass, "reflection1_samples_a.Y", 4, "reflection1_samples_a.Y is 4 at 15,3"},
      {kPass, "reflection1_samples_b.Y", 2, nullptr},
      {kGeometry, "Z", 1e30f, nullptr},
      {kGeometry, "Z", NAN, "unit: Z is nan at 15,3"},
      {kGeometry, "reflection1_N.X", INFINITY, "unit: reflection1_N.X is inf at 15,3"},
  };
  for (const Case& c : cases) {
    LayeredImage pixels = RandomUnit({0, 1, 0, c.kind}, kRect, kSamples, 1).pixels;
    ASSERT_TRUE(CheckUnitValues(c.kind, kRect, kSamples, pixels, {}).ok());
    pixels.Get(c.channel).At(7, 3) = c.value;
    const absl::Status status = CheckUnitValues(c.kind, kRect, kSamples, pixels, {});
    EXPECT_EQ(status.ok(), c.message == nullptr) << c.channel << ' ' << c.value;
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.message == nullptr ? "" : c.message));
  }
}

TEST(UnitLayout, BlocksHaveCountsOfTheirOwn) {
  constexpr Rect kTile = {0, 0, 2 * kSampleBlock, kSampleBlock};
  const TileSamples samples(kTile.x1, kTile.y1, {{0, 4}, {0, 8}});
  LayeredImage pixels = RandomUnit({0, 0, 0, v1::UNIT_KIND_PASS}, kTile, SampleRange{0, 4}, 1).pixels;
  const auto check = [&] { return CheckUnitValues(v1::UNIT_KIND_PASS, kTile, samples, pixels, {}); };
  EXPECT_THAT(std::string(check().message()),
              HasSubstr("has 32 samples and 0 bad ones, but its pass has 48"));
  for (const std::string_view half : {layers::kSamplesA, layers::kSamplesB}) {
    const FloatView counts = pixels.Get(half);
    for (int y = 0; y < kTile.y1; ++y) {
      for (int x = kSampleBlock; x < kTile.x1; ++x) counts.At(x, y) = 4;
    }
  }
  EXPECT_TRUE(check().ok()) << check();
  pixels.Get(layers::kSamplesB).At(1, 1) = 3;
  EXPECT_THAT(std::string(check().message()),
              HasSubstr("samples_b.Y is 3 at 1,1, not a whole number from 0 to 2"));
  pixels.Get(layers::kSamplesB).At(1, 1) = 2;
  pixels.Get(layers::kSamplesA).At(2, 1) = 5;
  EXPECT_THAT(std::string(check().message()),
              HasSubstr("samples_a.Y is 5 at 2,1, not a whole number from 0 to 4"));
}

TEST(UnitLayout, StatisticsAgreeWithTheCounts) {
  constexpr SampleRange kSamples = {0, 4};
  LayeredImage pixels = RandomUnit({0, 0, 0, v1::UNIT_KIND_PASS}, kRect, kSamples, 1).pixels;
  const auto check = [&](const v1::UnitStats& stats) {
    return CheckUnitValues(v1::UNIT_KIND_PASS, kRect, kSamples, pixels, stats).ok();
  };
  v1::UnitStats stats;
  stats.set_bad_samples(1);
  EXPECT_FALSE(check(stats));
  pixels.Get(layers::kSamplesA).At(0, 0) = 1;  // of two samples one was bad
  EXPECT_TRUE(check(stats));
  stats.set_bad_samples(-1);
  EXPECT_FALSE(check(stats));
  stats.set_bad_samples(1);
  stats.set_seconds(NAN);
  EXPECT_FALSE(check(stats));
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

TEST(UnitLayout, APlanLeavesOutLayersAndLevels) {
  const UnitModel diffuse = {.carried = {.glossy = false}, .levels = 0};
  EXPECT_THAT(PassChannels(diffuse), SizeIs(3 * 2 * 3 + 2 * 3 + 2));
  v1::PixelLayout layout = Layout(v1::UNIT_KIND_PASS);
  EXPECT_FALSE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout, diffuse).ok()) << "it has G and S";
  layout.clear_channels();
  for (const std::string& name : PassChannels(diffuse)) layout.add_channels(name);
  EXPECT_TRUE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout, diffuse).ok());
  EXPECT_FALSE(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout).ok()) << "it has neither";
  for (const std::string& name : layers::LevelPassChannels({layers::Branch::kReflection, 2}))
    layout.add_channels(name);
  EXPECT_EQ(CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout, {.carried = {.glossy = false}, .levels = 1})
                .message(),
            "unit: has the level reflection2, but its job plans 1 levels");
  EXPECT_TRUE(
      CheckUnitLayout(v1::UNIT_KIND_PASS, kRect, layout, {.carried = {.glossy = false}, .levels = 2}).ok());
}

}  // namespace
}  // namespace lumifold::film
