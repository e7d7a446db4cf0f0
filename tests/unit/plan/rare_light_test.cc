// Light that the probe hardly sees, or does not see at all, is still in the planned picture: its mean is that
// of the full plan, as far as the standard error of many independent renderings tells.
#include "tests/support/rare_light.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/analytic_scenes.h"
#include "tests/unit/plan/plan_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::plan {
namespace {

using lumifold::testing::CausticRoom;
using lumifold::testing::KeyholeRoom;
using lumifold::testing::Lambert;
using scene::Scene;

struct Part {
  Rect rect;
  uint32_t samples = 32;
  int renderings = 6;
};

/// Means of C over a part of the picture. Every rendering has random numbers of its own: those of another
/// frame.
std::vector<double> MeansOf(const Scene& scene, const render::RenderSettings& settings, const Part& part) {
  const auto renderer = render::MakeRenderer(scene, settings);
  std::vector<double> means;
  for (int frame = 0; frame < part.renderings; ++frame) {
    render::RenderCounts counts;
    const LayeredImage pass = renderer->RenderPass(part.rect, frame, {0, part.samples}, &counts).pixels;
    EXPECT_EQ(counts.bad_samples, 0);
    means.push_back(render::MeanOf(pass, layers::kNoisy));
  }
  return means;
}

struct Estimate {
  double mean = 0;
  double standard_error = 0;
};

Estimate EstimateOf(const std::vector<double>& values) {
  Estimate estimate;
  const auto count = static_cast<double>(values.size());
  for (const double value : values) estimate.mean += value / count;
  double squares = 0;
  for (const double value : values) squares += (value - estimate.mean) * (value - estimate.mean);
  estimate.standard_error = std::sqrt(squares / (count - 1) / count);
  return estimate;
}

render::RenderSettings Obeying(render::RenderSettings settings, const Plan& plan) {
  settings.plan = plan.tracing;
  settings.max_bounces = plan.max_bounces;
  return settings;
}

/// Expects the mean of C to be that of the full plan within 3 standard errors of the paired differences,
/// which must be small enough to see a hundredth of it missing. Returns the mean of the full plan.
Estimate ExpectUnbiased(const Scene& scene, const PlanSettings& settings, const Plan& plan,
                        const Part& part) {
  const std::vector<double> full = MeansOf(scene, settings.render, part);
  std::vector<double> differences = MeansOf(scene, Obeying(settings.render, plan), part);
  for (size_t i = 0; i < full.size(); ++i) differences[i] -= full[i];
  const Estimate difference = EstimateOf(differences);
  const Estimate expected = EstimateOf(full);
  EXPECT_GT(expected.mean, 0);
  EXPECT_LE(std::abs(difference.mean), 3 * difference.standard_error) << "of a mean of " << expected.mean;
  EXPECT_LE(3 * difference.standard_error, 0.01 * expected.mean);
  return expected;
}

TEST(RareLight, ACausticIsInThePlannedPicture) {
  const PlanSettings settings = SettingsFor();
  const Scene room = CausticRoom(Mirror());
  const Plan plan = PlanOf(room, settings);
  EXPECT_EQ(ValueOf(plan, "levels"), "1") << "a ball does not see itself";
  const Part floor = {.rect = {16, 24, 64, 48}, .renderings = 40};
  const Estimate with = ExpectUnbiased(room, settings, plan, floor);
  // It is there at all: a ball that does not reflect leaves less light.
  const Estimate without = EstimateOf(
      MeansOf(CausticRoom(Lambert({0, 0, 0})), settings.render, {.rect = floor.rect, .renderings = 10}));
  EXPECT_GT(with.mean - without.mean, 10 * (with.standard_error + without.standard_error));
}

TEST(RareLight, LightThroughAKeyholeIsInThePlannedPicture) {
  const PlanSettings settings = SettingsFor();
  const Scene room = KeyholeRoom(0.15f, Lambert({0.5f, 0.5f, 0.5f}));
  ExpectUnbiased(room, settings, PlanOf(room, settings), {{0, 0, 64, 48}});
  const Estimate closed = EstimateOf(
      MeansOf(KeyholeRoom(0, Lambert({0.5f, 0.5f, 0.5f})), settings.render, {{0, 0, 64, 48}, 4, 2}));
  EXPECT_EQ(closed.mean, 0);
}

TEST(RareLight, MirrorsBehindAKeyholeThatTheProbeMissesLoseNoLight) {
  PlanSettings settings = SettingsFor();
  settings.render.width = 512;
  settings.render.height = 384;
  Scene hall = KeyholeRoom(0.01f, Mirror());
  lumifold::testing::Place(&hall, lumifold::testing::SphereMesh(0.5f, 12, 2));
  hall.instances.back().world_from_object.origin = {0.41f, 0, -1};  // it shows the mirrors at the sides
  const Plan plan = PlanOf(hall, settings);
  ASSERT_EQ(ValueOf(plan, "levels"), "1") << "the hole is smaller than a pixel of the probe";
  EXPECT_EQ(Find(plan, "levels").source, Source::kProbe);
  const Part keyhole = {{248, 180, 264, 196}, 128, 16};
  ExpectUnbiased(hall, settings, plan, keyhole);
  // What is left out matters there.
  const auto renderer = render::MakeRenderer(hall, settings.render);
  render::RenderCounts counts;
  const LayeredImage pass = renderer->RenderPass(keyhole.rect, 0, {0, 64}, &counts).pixels;
  EXPECT_TRUE(pass.Has("reflection2_emission.R"));
}

}  // namespace
}  // namespace lumifold::plan
