#include "worker/plan/probe.h"

#include <gtest/gtest.h>

#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/analytic_scenes.h"
#include "tests/unit/plan/plan_scenes.h"

namespace lumifold::plan {
namespace {

using scene::Scene;

Probe ProbeOf(const Scene& scene, const render::RenderSettings& settings, int32_t samples = kAmpleSamples) {
  const auto probe = RunProbe(scene, settings, samples);
  EXPECT_TRUE(probe.ok()) << probe.status();
  return *probe;
}

TEST(Probe, IsTheSameInEveryRunAndThread) {
  const Scene room = lumifold::testing::SmallRoom();
  const PlanSettings settings = SettingsFor();
  const std::string alone = TextOf(PlanOf(room, settings));
  std::vector<std::string> together(3);
  std::vector<std::thread> threads;
  threads.reserve(together.size());
  for (std::string& json : together) threads.emplace_back([&] { json = TextOf(PlanOf(room, settings)); });
  for (std::thread& thread : threads) thread.join();
  for (const std::string& json : together) EXPECT_EQ(json, alone);
}

TEST(Probe, HasTheFramesAspectRatioAndAboutAFixedNumberOfPixels) {
  for (const auto& [width, height] : {std::pair{1024, 768}, {16384, 1}, {3, 5}, {7000, 40}}) {
    render::RenderSettings settings;
    settings.width = width;
    settings.height = height;
    const Probe probe = ProbeOf(Sheet(lumifold::testing::Lambert({1, 1, 1})), settings);
    EXPECT_LE(probe.width * probe.height, kProbePixels * 1.1) << width;
    EXPECT_LE(probe.width, width);
    EXPECT_GE(probe.height, 1);
    EXPECT_GE(probe.samples, int64_t{probe.width} * probe.height * int64_t{kProbeSamples});
    EXPECT_EQ(probe.rays_of_pixel.size(), static_cast<size_t>(probe.width * probe.height));
  }
}

TEST(Probe, IsASmallPartOfASmallJob) {
  const Scene sheet = Sheet(lumifold::testing::Lambert({1, 1, 1}));
  render::RenderSettings settings;
  settings.width = 216;
  settings.height = 162;
  const int64_t pixels = int64_t{216} * 162;
  const Probe of_usual = ProbeOf(sheet, settings, 256);
  EXPECT_LE(of_usual.samples, pixels * 256 / kSamplesPerProbeSample);
  EXPECT_GE(of_usual.samples, pixels * 256 / kSamplesPerProbeSample * 9 / 10);
  const Probe of_least = ProbeOf(sheet, settings, 1);
  EXPECT_NEAR(of_least.width * of_least.height, kLeastProbePixels, 16);
  settings.width = 12;
  settings.height = 9;
  EXPECT_EQ(ProbeOf(sheet, settings, 1).rays_of_pixel.size(), 12u * 9u) << "all pixels of a smaller frame";
}

TEST(Probe, CountsTheRaysOfAScene) {
  // Every camera ray hits; nothing emits or scatters: one ray for each sample.
  const Probe probe = ProbeOf(Box(lumifold::testing::Lambert({0, 0, 0})), SettingsFor().render);
  EXPECT_EQ(probe.rays, probe.samples);
  EXPECT_EQ(probe.RaysPerSample(), 1);
  // A camera ray, a scattered ray, and a shadow ray to the light sample.
  const Probe sheet = ProbeOf(Sheet(lumifold::testing::Lambert({1, 1, 1})), SettingsFor(WhiteSky()).render);
  // Half of the light samples lie behind it.
  EXPECT_NEAR(sheet.RaysPerSample({24, 16, 40, 32}, 64, 48), 2.5, 0.01);
  EXPECT_EQ(sheet.RaysPerSample({0, 0, 2, 2}, 64, 48), 1) << "a corner without the sheet";
}

TEST(Probe, APictureWithoutNoiseHasNone) {
  EXPECT_EQ(ProbeOf(Box(lumifold::testing::Emitter({3, 2, 1})), SettingsFor().render).noise, 0);
  EXPECT_EQ(ProbeOf(Box(lumifold::testing::Lambert({1, 1, 1})), SettingsFor().render).noise, 0) << "black";
  EXPECT_GT(ProbeOf(lumifold::testing::SmallRoom(), SettingsFor().render).noise, 0.01);
}

TEST(Probe, MissesOfTheCameraAreNamed) {
  render::RenderSettings settings = SettingsFor().render;
  settings.camera = "none";
  const auto probe = RunProbe(lumifold::testing::SmallRoom(), settings, kAmpleSamples);
  EXPECT_EQ(probe.status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace lumifold::plan
