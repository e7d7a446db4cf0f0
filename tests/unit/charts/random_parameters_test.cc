#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "filter/image/planes.h"
#include "tests/charts/methods/samples/neighbourhood.h"
#include "tests/charts/methods/samples/random_parameters.h"

namespace lumifold::charts {
namespace {

using scene::Vec3;

constexpr int kDrawnWidth = 24;
constexpr int kDrawnHeight = 16;
constexpr uint32_t kDrawnSamples = 8;

/// A wall whose right half is 50 m behind the left; `radiance` gives that of each sample.
template <typename Radiance>
SampleSet Wall(Radiance radiance) {
  SampleSet set;
  set.width = kDrawnWidth;
  set.height = kDrawnHeight;
  set.samples_per_pixel = kDrawnSamples;
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
  for (int i = 0; i < kDrawnWidth * kDrawnHeight; ++i) {
    for (uint32_t k = 0; k < kDrawnSamples; ++k) {
      ChartSample s;
      const int x = i % kDrawnWidth;
      const int y = i / kDrawnWidth;
      s.point = {static_cast<float>(x) + uniform(random), static_cast<float>(y) + uniform(random)};
      s.distance = x < kDrawnWidth / 2 ? 2.0f : 52.0f;
      s.position = {0.01f * s.point.x, 0.01f * s.point.y, s.distance};
      s.normal = {0, 0, 1};
      s.albedo = {0.5f, 0.5f, 0.5f};
      for (scene::Vec2& pair : s.random) pair = {uniform(random), uniform(random)};
      s.radiance = radiance(s);
      set.samples.push_back(s);
    }
  }
  return set;
}

std::vector<Vec3> RadiancesOf(const SampleSet& set) {
  std::vector<Vec3> colors;
  for (const ChartSample& sample : set.samples) colors.push_back(sample.radiance);
  return colors;
}

TEST(Neighbourhood, HoldsThePixelsOwnSamplesAndNoneFromBehindAnEdge) {
  const SampleSet set = Wall([](const ChartSample& s) { return Vec3{s.distance, 0, 0}; });
  Neighbourhood samples;
  samples.Draw(set, RadiancesOf(set), kDrawnWidth / 2 - 1, 8, 0, 17, 600);
  EXPECT_GT(samples.size(), 150u);
  for (size_t i = 0; i < samples.size(); ++i) EXPECT_EQ(samples.colors()[i].x, 2) << i;
}

TEST(Neighbourhood, IsStandardised) {
  const SampleSet set = Wall([](const ChartSample& s) { return Vec3{s.random[0].x, 1, 0}; });
  Neighbourhood samples;
  samples.Draw(set, RadiancesOf(set), 4, 8, 1, 17, 300);
  double sum = 0;
  double squares = 0;
  for (const float value : samples.Standard(Variables::kColor)) {
    sum += static_cast<double>(value);
    squares += static_cast<double>(value) * static_cast<double>(value);
  }
  const double count = static_cast<double>(samples.size());
  EXPECT_NEAR(sum / count, 0, 1e-5);
  EXPECT_NEAR(squares / count, 1, 1e-4);
  for (const float value : samples.Standard(Variables::kColor + 1)) EXPECT_EQ(value, 0);  // does not vary
}

/// Mean square of the first channel about `truth`.
template <typename Truth>
double ErrorOf(const Picture& picture, Truth truth) {
  double sum = 0;
  ForEachPixel(kDrawnWidth, kDrawnHeight, [&](int x, int y) {
    sum += std::pow(static_cast<double>(picture[0].At(x, y)) - truth(x, y), 2);
  });
  return sum / (kDrawnWidth * kDrawnHeight);
}

Picture Filtered(const SampleSet& set) {
  return *RandomParametersMethod().filter(set, {0.02f, 1, 1}, nullptr);
}

TEST(RandomParameters, SmoothsWhatDependsOnChanceAndKeepsWhatDependsOnPlace) {
  const SampleSet chance = Wall([](const ChartSample& s) {
    const float value = s.random[1].x < 0.5f ? 0.0f : 2.0f;
    return Vec3{value, value, value};
  });
  EXPECT_LT(ErrorOf(Filtered(chance), [](int, int) { return 1.0; }), 0.25 / kDrawnSamples);
  const auto stripe = [](int x) { return x / 2 % 2 == 0 ? 0.5 : 1.5; };
  const SampleSet place = Wall([&](const ChartSample& s) {
    const float value = static_cast<float>(stripe(static_cast<int>(s.point.x)));
    return Vec3{value, value, value};
  });
  EXPECT_LT(ErrorOf(Filtered(place), [&](int x, int) { return stripe(x); }), 0.01);
}

}  // namespace
}  // namespace lumifold::charts
