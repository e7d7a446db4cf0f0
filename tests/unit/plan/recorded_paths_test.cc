// What paths that were traced without Russian roulette tell of a rule.
#include "worker/plan/recorded_paths.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "tests/support/analytic_scenes.h"
#include "tests/unit/plan/plan_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/plan/probe.h"

namespace lumifold::plan {
namespace {

using render::PathVertex;
using render::Roulette;
using scene::Vec3;

/// Brings 1, 3 and 2 where it gets to, and halves its throughput each time.
std::vector<PathVertex> Path() {
  return {{Vec3{1, 1, 1}, 0.5f, 2}, {Vec3{4, 4, 4}, 0.25f, 4}, {Vec3{6, 6, 6}, 0, 5}};
}

PathCosts CostsWith(const Roulette& rule, const PixelLight& pixel = {.light = 1, .outlier = 100}) {
  RecordedPaths paths;
  paths.Add(Path(), pixel);
  return paths.CostsWith(rule);
}

TEST(RecordedPaths, APathThatAlwaysGoesOnBringsAllOfItsLight) {
  const PathCosts costs = CostsWith({.percent = 10000});
  EXPECT_EQ(costs.noise, 3 * 6 * 6);
  EXPECT_EQ(costs.rays, 5);
}

TEST(RecordedPaths, CostsAreTheExpectationOverTheRulesDecisions) {
  // By its throughput it goes on in 1 of 2, then, with the throughput that makes up for it, in 1 of 2 again:
  // it brings 1, 1 + 2 * 3 or 1 + 2 * 3 + 4 * 2.
  const PathCosts costs = CostsWith({.percent = 100});
  EXPECT_DOUBLE_EQ(costs.noise, 3 * (0.5 * 1 * 1 + 0.25 * 7 * 7 + 0.25 * 15 * 15));
  EXPECT_DOUBLE_EQ(costs.rays, 0.5 * 2 + 0.25 * 4 + 0.25 * 5);
  // The usual rule lets it go on from the first bounce, and decides by the throughput of 1/4 at the second
  // one.
  const PathCosts usual = CostsWith({});
  EXPECT_DOUBLE_EQ(usual.noise, 3 * (0.75 * 4 * 4 + 0.25 * 12 * 12));
  EXPECT_DOUBLE_EQ(usual.rays, 0.75 * 4 + 0.25 * 5);
}

TEST(RecordedPaths, NoiseCountsRelativeToThePixelsLight) {
  const PixelLight bright = {.light = 4, .outlier = 100};
  EXPECT_EQ(4 * CostsWith({}, bright).noise, CostsWith({}).noise);
  EXPECT_EQ(CostsWith({}, bright).rays, CostsWith({}).rays);
  RecordedPaths none;
  none.Add({}, bright);
  EXPECT_EQ(none.CostsWith({}).rays, 0);
}

TEST(RecordedPaths, OutliersDoNotCountByTheirSquare) {
  EXPECT_EQ(CostsWith({.percent = 10000}, {.light = 1, .outlier = 6}).noise, 3 * 6 * 6);
  EXPECT_EQ(CostsWith({.percent = 10000}, {.light = 1, .outlier = 2}).noise, 3 * (2 * 2 + 2 * 2 * (6 - 2)));
}

TEST(RecordedPaths, BadRadianceCountsNothing) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    RecordedPaths paths;
    std::vector<PathVertex> path = Path();
    path.back().gathered.y = bad;
    paths.Add(path, {});
    EXPECT_EQ(paths.CostsWith({}).rays, 0) << bad;
    paths.Add(Path(), {.light = 1, .outlier = 100});
    EXPECT_EQ(paths.CostsWith({}).noise, CostsWith({}).noise) << bad;
  }
}

TEST(RecordedPaths, TellTheRaysAndTheLightOfAPictureByTheSameRule) {
  render::RenderSettings settings = SettingsFor().render;
  settings.width = 40;
  settings.height = 30;
  const scene::Scene room = LitBox(lumifold::testing::Lambert({0.8f, 0.5f, 0.3f}));
  const Probe probe = RunProbe(room, settings, kAmpleSamples).value();
  const auto rays_with = [&](const Roulette& rule) {
    settings.plan.roulette = rule;
    render::RenderCounts counts;
    const LayeredImage pass =
        render::MakeRenderer(room, settings)->RenderPass({0, 0, 40, 30}, 0, {0, 64}, &counts).pixels;
    return static_cast<double>(counts.rays) / static_cast<double>(counts.samples);
  };
  const double paths = 18.0 * 14 * kProbeSamples;  // of the recording, which has at most 256 pixels
  const double usual = rays_with({});
  for (const int percent : {100, 200, 1000}) {
    const Roulette rule = {.percent = percent};
    const double told = (probe.paths.CostsWith(rule).rays - probe.paths.CostsWith({}).rays) / paths;
    EXPECT_NEAR(rays_with(rule) - usual, told, 0.15) << percent << " beside " << usual;
  }
}

TEST(RecordedPaths, WeighTheirNoiseByTheLightOfTheirPixel) {
  render::RenderSettings settings = SettingsFor().render;
  settings.width = 16;
  settings.height = 12;
  const scene::Scene room = LitBox(lumifold::testing::Lambert({0.8f, 0.8f, 0.8f}));
  const Probe probe = RunProbe(room, settings, kAmpleSamples).value();
  const LayeredImage pass = render::RenderAll(*render::MakeRenderer(room, settings), 16, 12, 64);
  const double light = render::MeanOf(pass, layers::kNoisy);
  // Of one channel of one path: the square of the light that it brings, over the light of its pixel.
  const double noise = probe.paths.CostsWith({}).noise / (3.0 * 16 * 12 * kProbeSamples);
  EXPECT_GT(noise, light / 8);
  EXPECT_LT(noise, light * 8);
}

TEST(RecordedPaths, APathOfManyBouncesIsCutOff) {
  render::RenderSettings settings = SettingsFor().render;
  settings.width = 8;
  settings.height = 6;
  settings.max_bounces = 200;
  const auto rays = [&] {
    const Probe probe = RunProbe(LitBox(lumifold::testing::Lambert({1, 1, 1})), settings, 1).value();
    return probe.paths.CostsWith({.percent = 10000}).rays / (8.0 * 6 * kProbeSamples);
  };
  EXPECT_LE(rays(), 2 * 17) << "a ray to each vertex, and its shadow ray";
  EXPECT_GT(rays(), 16);
}

}  // namespace
}  // namespace lumifold::plan
