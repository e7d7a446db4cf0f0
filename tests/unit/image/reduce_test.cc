#include "filter/image/reduce.h"

#include <gtest/gtest.h>

#include "filter/image/layers.h"

namespace lumifold {
namespace {

/// A film of 3 x 2 pixels with the values of one row after the other.
void Add(LayeredImage* film, std::string_view name, const std::vector<float>& values) {
  const FloatView view = film->Add(std::string(name));
  for (size_t i = 0; i < values.size(); ++i)
    view.At(static_cast<int>(i) % film->width(), static_cast<int>(i) / film->width()) = values[i];
}

void AddGrey(LayeredImage* film, const std::string& layer, const std::vector<float>& values) {
  for (const std::string& channel : layers::ColorChannels(layer)) Add(film, channel, values);
}

class ReduceTest : public ::testing::Test {
 protected:
  ReduceTest() {
    Add(&film_, layers::kSamplesA, {1, 3, 4, 0, 0, 2});
    Add(&film_, layers::kSamplesB, {1, 1, 4, 2, 0, 2});
  }

  LayeredImage film_{3, 2};
};

TEST_F(ReduceTest, SamplesAreAddedUpAndTheBorderMayHaveFewerPixels) {
  const LayeredImage reduced = ReduceFilm(film_, 2);
  ASSERT_EQ(reduced.width(), 2);
  ASSERT_EQ(reduced.height(), 1);
  EXPECT_EQ(reduced.Get(layers::kSamplesA).At(0, 0), 4);
  EXPECT_EQ(reduced.Get(layers::kSamplesB).At(0, 0), 4);
  EXPECT_EQ(reduced.Get(layers::kSamplesA).At(1, 0), 6);
}

TEST_F(ReduceTest, MeansAreOverTheSamplesThatAreInThem) {
  AddGrey(&film_, std::string(layers::kDirect), {1, 2, 7, 4, 100, 9});
  AddGrey(&film_, layers::HalfA(layers::kDirect), {1, 2, 7, 100, 100, 9});
  AddGrey(&film_, layers::HalfB(layers::kDirect), {1, 2, 7, 4, 100, 9});
  AddGrey(&film_, std::string(layers::kAlbedo), {1, 2, 7, 4, 100, 9});
  const LayeredImage reduced = ReduceFilm(film_, 2);
  EXPECT_EQ(reduced.Get("direct.G").At(0, 0),
            (1 * 2 + 2 * 4 + 4 * 2) / 8.0f);  // a pixel without samples is not in it
  EXPECT_EQ(reduced.Get("direct_a.G").At(0, 0), (1 * 1 + 2 * 3) / 4.0f);
  EXPECT_EQ(reduced.Get("direct_b.G").At(0, 0), (1 * 1 + 2 * 1 + 4 * 2) / 4.0f);
  EXPECT_EQ(reduced.Get("albedo.G").At(0, 0), (1 * 2 + 2 * 4 + 4 * 2) / 8.0f);
  EXPECT_EQ(reduced.Get("direct.G").At(1, 0), (7 * 8 + 9 * 4) / 12.0f);
}

TEST_F(ReduceTest, HalvesOfALevelHaveItsOwnCounts) {
  const layers::Level level{layers::Branch::kReflection, 1};
  Add(&film_, layers::OfLevel(level, layers::kSamplesA), {1, 0, 0, 1, 0, 0});
  Add(&film_, layers::OfLevel(level, layers::kSamplesB), {0, 0, 0, 0, 0, 0});
  AddGrey(&film_, layers::OfLevel(level, layers::HalfA(layers::kDirect)), {5, 100, 0, 7, 0, 0});
  AddGrey(&film_, layers::OfLevel(level, layers::HalfB(layers::kDirect)), {5, 100, 0, 7, 0, 0});
  AddGrey(&film_, layers::OfLevel(level, layers::kAlbedo), {1, 2, 0, 4, 0, 0});
  const LayeredImage reduced = ReduceFilm(film_, 2);
  EXPECT_EQ(reduced.Get("reflection1_direct_a.R").At(0, 0), 6);
  EXPECT_EQ(reduced.Get("reflection1_direct_b.R").At(0, 0), 0) << "no sample";
  EXPECT_EQ(reduced.Get("reflection1_albedo.R").At(0, 0), (1 * 2 + 2 * 4 + 4 * 2) / 8.0f)
      << "over all samples";
}

TEST_F(ReduceTest, FeaturesAreMeansOverPixelsButAnObjectIdIsThatOfOne) {
  Add(&film_, layers::kNormalX, {1, 2, 3, 4, 5, 6});
  Add(&film_, layers::kObjectId, {1, 2, 3, 4, 5, 6});
  const LayeredImage reduced = ReduceFilm(film_, 2);
  EXPECT_EQ(reduced.Get(layers::kNormalX).At(0, 0), 3);
  EXPECT_EQ(reduced.Get(layers::kObjectId).At(0, 0), 5);
  EXPECT_EQ(reduced.Get(layers::kObjectId).At(1, 0), 6);
}

TEST_F(ReduceTest, AFactorOfOneChangesNothing) {
  Add(&film_, layers::kNormalX, {1, 2, 3, 4, 5, 6});
  const LayeredImage reduced = ReduceFilm(film_, 1);
  for (const LayeredImage::Channel& channel : film_.channels()) {
    for (int i = 0; i < 6; ++i)
      EXPECT_EQ(reduced.Get(channel.name).At(i % 3, i / 3), channel.plane.At(i % 3, i / 3)) << channel.name;
  }
}

}  // namespace
}  // namespace lumifold
