#include "tests/charts/plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/file_io.h"
#include "filter/image/layers.h"
#include "tests/charts/by_scene.h"
#include "tests/charts/mean_ratio.h"

namespace lumifold::charts {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using Pairs = std::vector<std::pair<double, double>>;

TEST(MeanRatio, IsTheMeanOfTheRatiosAndItsStandardError) {
  const auto ratio = MeanRatioOf(Pairs{{1, 0.5}, {4, 4.4}, {2, 1.8}});
  ASSERT_TRUE(ratio.has_value());
  EXPECT_NEAR(ratio->mean, (0.5 + 1.1 + 0.9) / 3, 1e-12);
  EXPECT_NEAR(ratio->standard_error,
              std::sqrt((0.333333 * 0.333333 + 0.266667 * 0.266667 + 0.066667 * 0.066667) / 6), 1e-5);
  EXPECT_EQ(RatioCell(ratio), "0.833 ± 0.176");
}

TEST(MeanRatio, OfEqualPairsIsOneWithoutError) {
  EXPECT_EQ(RatioCell(MeanRatioOf(Pairs{{3, 3}, {0, 0}, {-1, -1}})), "1.000");
  EXPECT_EQ(MeanRatioOf(Pairs{{2, 1}})->standard_error, 0) << "one pair";
}

TEST(MeanRatio, NeedsSomethingToCompareWith) {
  EXPECT_FALSE(MeanRatioOf(Pairs{}).has_value());
  EXPECT_FALSE(MeanRatioOf(Pairs{{1, 1}, {0, 1}}).has_value());
  EXPECT_FALSE(MeanRatioOf(Pairs{{-1, 1}}).has_value()) << "less than the reference's noise";
  EXPECT_EQ(RatioCell(std::nullopt), "-");
}

TEST(KeepsAccuracy, AllowsOnePercentAndTwoStandardErrors) {
  EXPECT_TRUE(KeepsAccuracy({0.5, 0}));
  EXPECT_TRUE(KeepsAccuracy({1.01, 0}));
  EXPECT_FALSE(KeepsAccuracy({1.02, 0}));
  EXPECT_TRUE(KeepsAccuracy({1.02, 0.006}));
  EXPECT_FALSE(KeepsAccuracy({1.02, 0.004}));
}

TEST(ByScene, DividesRowsWhereTheSceneChanges) {
  const std::vector<PlanPair> pairs = {{.scene = "a"}, {.scene = "a"}, {.scene = "b"}};
  const auto scenes = ByScene(pairs);
  ASSERT_EQ(scenes.size(), 2u);
  EXPECT_EQ(scenes[0].size(), 2u);
  EXPECT_EQ(scenes[1][0].scene, "b");
  EXPECT_TRUE(ByScene(std::vector<PlanPair>()).empty());
}

class PlanChart : public ::testing::Test {
 protected:
  PlanChart() { std::filesystem::create_directories(folder_); }
  ~PlanChart() override { std::filesystem::remove_all(folder_); }

  std::vector<PlanPair> Measure(const std::string& scene, int seeds) {
    const absl::StatusOr<FilmSource> source = FilmSource::Create(scene, folder_);
    EXPECT_TRUE(source.ok()) << source.status();
    absl::StatusOr<RenderedFilm> truth =
        source->Get({kSettings.width, kSettings.height, 64, kReferenceSeed}, nullptr);
    EXPECT_TRUE(truth.ok()) << truth.status();
    const absl::StatusOr<Reference> reference = MakeReference("truth", std::move(truth->film));
    absl::StatusOr<std::vector<PlanPair>> pairs =
        MeasurePlan(scene, *source, kSettings, seeds, *reference, folder_, nullptr);
    EXPECT_TRUE(pairs.ok()) << pairs.status();
    return *std::move(pairs);
  }

  static constexpr FilmSettings kSettings = {40, 24, 6, 0};
  const std::string folder_ =
      ::testing::TempDir() + "/" + ::testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(PlanChart, PlannedJobsOfADiffuseSceneCarryLessAndPayForTheirProbe) {
  const std::vector<PlanPair> pairs = Measure("tiny-diffuse", 2);
  ASSERT_EQ(pairs.size(), 2u);
  for (const PlanPair& pair : pairs) {
    EXPECT_TRUE(pair.is_diffuse);
    EXPECT_THAT(DifferencesOf({&pair, 1}), HasSubstr("levels 0, glossy off, general-code off"));
    EXPECT_EQ(pair.full.camera_paths, 40 * 24 * 6);
    EXPECT_EQ(pair.planned.camera_paths, pair.full.camera_paths + 21 * 12 * 8) << "those of the least probe";
    EXPECT_LT(20 * pair.planned.costs.float_bytes, 19 * pair.full.costs.float_bytes);
    EXPECT_EQ(pair.full.costs.plan_seconds, 0);
    EXPECT_GT(pair.planned.costs.plan_seconds, 0);
    for (const PlannedJob* job : {&pair.full, &pair.planned}) {
      EXPECT_GT(job->costs.wire_bytes, job->costs.float_bytes / 10);
      EXPECT_LT(job->costs.wire_bytes, job->costs.float_bytes);
      EXPECT_LT(std::abs(job->costs.stored_bytes - job->costs.wire_bytes), job->costs.wire_bytes / 10);
    }
  }
  EXPECT_NE(pairs[0].full.mse255, pairs[1].full.mse255) << "another seed";
  EXPECT_TRUE(std::filesystem::exists(folder_));
  EXPECT_FALSE(std::filesystem::exists(folder_ + "/job.units"));
}

TEST_F(PlanChart, DifferencesOfSeedsAreARange) {
  std::vector<PlanPair> pairs(3);
  pairs[0].differences = {{"pass-samples", 256}, {"levels", 1}, {"glossy", 0}};
  pairs[1].differences = {{"pass-samples", 64}, {"glossy", 0}};
  pairs[2].differences = {{"pass-samples", 128}, {"glossy", 0}};
  EXPECT_EQ(DifferencesOf(pairs), "levels 1 with some seeds, glossy off, pass-samples 64 to 256");
}

TEST_F(PlanChart, MirrorsAreNotDiffuse) {
  const std::vector<PlanPair> pairs = Measure("tiny-mirror", 1);
  EXPECT_FALSE(pairs[0].is_diffuse);
  EXPECT_THAT(DifferencesOf(pairs), HasSubstr("direct off, indirect off, albedo off"));
}

TEST_F(PlanChart, WritesTheRatiosOfEveryScene) {
  PlannedJob full = {.camera_paths = 100, .costs = {.wire_bytes = 1000, .render_seconds = 2}, .mse255 = 4};
  PlannedJob planned = {
      .camera_paths = 110, .costs = {.wire_bytes = 700, .render_seconds = 1.9}, .mse255 = 4.2};
  const std::vector<PlanPair> pairs = {
      {.scene = "room", .is_diffuse = true, .full = full, .planned = planned},
      {.scene = "hall", .full = full, .planned = full}};
  ASSERT_TRUE(ChartPlan(folder_, pairs, kSettings, {"the command", 1}, DrawFormat::kSvg).ok());
  const std::string page = ReadFile(folder_ + "/plan.md", 1 << 20).value();
  EXPECT_THAT(page, HasSubstr("the command"));
  EXPECT_THAT(page, HasSubstr("| room | 1.100 |"));
  EXPECT_THAT(page, HasSubstr("| 0.950 | 1.050 | no | yes | no |\n")) << "time, error, and the verdicts";
  EXPECT_THAT(page, HasSubstr("| hall | 1.000 |"));
  EXPECT_THAT(page, HasSubstr("| 1.000 | 1.000 | yes |  |  |\n"));
  EXPECT_THAT(page, Not(HasSubstr("nan")));
  const std::string csv = ReadFile(folder_ + "/plan.csv", 1 << 20).value();
  EXPECT_THAT(csv, HasSubstr("room,0,full,100,0,0,1000,"));
  EXPECT_THAT(csv, HasSubstr("room,0,auto,110,0,0,700,"));
}

}  // namespace
}  // namespace lumifold::charts
