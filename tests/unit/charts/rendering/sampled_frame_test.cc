#include "tests/charts/methods/rendering/sampled_frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/charts/methods/rendering/gaussian.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::charts {
namespace {

using render::MakeRenderer;
using render::RenderAll;
using render::RenderSettings;
using render::SettingsOf;
using ::testing::UnorderedElementsAre;

constexpr int kFrameWidth = 12;
constexpr int kFrameHeight = 9;
constexpr size_t kPixels = size_t{kFrameWidth} * kFrameHeight;

class SampledFrameTest : public ::testing::Test {
 protected:
  static RenderSettings settings() { return SettingsOf(kFrameWidth, kFrameHeight, 2); }

  CameraFrame frame_ = *CameraFrame::Create(std::make_shared<scene::Scene>(testing::SmallRoom()), settings());
  SampledFrame sampled_{frame_};
};

TEST_F(SampledFrameTest, HoldsTheSamplesOfAPass) {
  sampled_.Take(std::vector<uint32_t>(kPixels, 6), nullptr);
  const LayeredImage pass =
      RenderAllRadiance(*MakeRenderer(testing::SmallRoom(), settings()), kFrameWidth, kFrameHeight, 6);
  const ConstColorView a = pass.GetColor(layers::HalfA(layers::kNoisy));
  const ConstColorView b = pass.GetColor(layers::HalfB(layers::kNoisy));
  const Planes means = sampled_.Means();
  const Planes half_b = sampled_.HalfMeans(1);
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(kFrameWidth, kFrameHeight, [&](int x, int y) {
      const float all = (a[c].At(x, y) + b[c].At(x, y)) / 6;
      EXPECT_NEAR(means[c].At(x, y), all, 1e-5f * (1 + all));
      EXPECT_NEAR(half_b[c].At(x, y), b[c].At(x, y) / 3, 1e-5f * (1 + all));
    });
  }
  EXPECT_EQ(sampled_.taken(), kPixels * 6);
}

TEST_F(SampledFrameTest, GoesOnWhereAPixelEnded) {
  std::vector<uint32_t> more(kPixels, 3);
  sampled_.Take(more, nullptr);
  more.assign(kPixels, 0);
  more[5] = 7;
  sampled_.Take(more, nullptr);
  SampledFrame at_once(frame_);
  more.assign(kPixels, 3);
  more[5] = 10;
  at_once.Take(more, nullptr);
  EXPECT_NEAR(sampled_.Means()[1].At(5, 0), at_once.Means()[1].At(5, 0), 1e-5f);
  EXPECT_EQ(sampled_.Counts().At(5, 0), 10);
  EXPECT_EQ(sampled_.Counts().At(6, 0), 3);
  EXPECT_FLOAT_EQ(sampled_.ShareOfHalfA().At(6, 0), 2.0f / 3);
}

TEST_F(SampledFrameTest, BeginsWithAQuarterAndAtLeastFour) {
  for (const auto& [all, first] : {std::pair<uint32_t, float>{1, 1}, {3, 3}, {8, 4}, {64, 16}}) {
    SampledFrame frame(frame_);
    frame.TakeFirst(all, nullptr);
    EXPECT_EQ(frame.Counts().At(0, 0), first) << all;
  }
}

TEST_F(SampledFrameTest, KnowsTheVarianceOfItsMeans) {
  // All pixels of a very narrow view show the same point, so their means differ only by noise.
  scene::Scene scene = testing::SmallRoom();
  scene.cameras = {testing::LookAt({0, 0, 1.9f}, {0.3f, 0.4f, -2}, 1e-3f)};
  const CameraFrame frame =
      *CameraFrame::Create(std::make_shared<scene::Scene>(std::move(scene)), settings());
  SampledFrame sampled(frame);
  // One sample per half: nothing is stratified, so samples are independent.
  sampled.Take(std::vector<uint32_t>(kPixels, 2), nullptr);
  double expected = 0;
  double squares = 0;
  double sum = 0;
  ForEachPixel(kFrameWidth, kFrameHeight, [&](int x, int y) {
    const auto mean = static_cast<double>(sampled.Means()[1].At(x, y));
    expected += static_cast<double>(sampled.Variances()[1].At(x, y)) / kPixels;
    sum += mean;
    squares += mean * mean;
  });
  EXPECT_NEAR(expected / ((squares - sum * sum / kPixels) / (kPixels - 1)), 1, 0.35);
}

TEST_F(SampledFrameTest, TakesNeighboursForTheVarianceOfSingleSamples) {
  sampled_.Take(std::vector<uint32_t>(kPixels, 1), nullptr);
  const Planes variances = sampled_.Variances();
  double sum = 0;
  ForEachPixel(kFrameWidth, kFrameHeight,
               [&](int x, int y) { sum += static_cast<double>(variances[1].At(x, y)); });
  EXPECT_GT(sum, 0);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(WorthiestPixels, PreferLowNumbersAmongEquals) {
  Plane worth(4, 2);
  worth.At(3, 0) = 2;
  worth.At(1, 1) = 1;
  worth.At(0, 1) = 1;
  worth.At(2, 1) = 1;
  EXPECT_THAT(WorthiestPixels(worth, 3), UnorderedElementsAre(3, 4, 5));
  EXPECT_THAT(WorthiestPixels(worth, 0), ::testing::IsEmpty());
  EXPECT_EQ(WorthiestPixels(worth, 100).size(), 8u);
}

TEST(Gaussian, KeepsAConstantUpToTheEdges) {
  Plane values(17, 11);
  values.Fill(3);
  for (const float sigma : {0.0f, 0.7f, 2.0f, 8.0f}) {
    const Plane mean = Gaussian(sigma, 17, 11).Mean(values, nullptr);
    ForEachPixel(17, 11, [&](int x, int y) { EXPECT_NEAR(mean.At(x, y), 3, 1e-5) << sigma; });
  }
}

TEST(Gaussian, LeavesVarianceOverTheAreaItAverages) {
  // Far from edges the sum of squared weights is 1 / (4 pi sigma^2).
  Plane ones(64, 64);
  ones.Fill(1);
  constexpr float kSigma = 3;
  const Gaussian gaussian(kSigma, 64, 64);
  EXPECT_NEAR(gaussian.VarianceOfMean(ones, nullptr).At(32, 32) * (4 * M_PI * 9), 1, 0.01);
  EXPECT_NEAR(gaussian.CentreWeight(32, 32) * (2 * M_PI * 9), 1, 0.01);
  EXPECT_EQ(Gaussian(0, 64, 64).VarianceOfMean(ones, nullptr).At(32, 32), 1);
}

}  // namespace
}  // namespace lumifold::charts
