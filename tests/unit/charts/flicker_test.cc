#include "tests/charts/flicker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "filter/image/file_io.h"

namespace lumifold::charts {
namespace {

using ::testing::HasSubstr;

class FlickerChart : public ::testing::Test {
 protected:
  FlickerChart() { std::filesystem::create_directories(folder_); }
  ~FlickerChart() override { std::filesystem::remove_all(folder_); }

  const std::string folder_ =
      ::testing::TempDir() + "/" + ::testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(FlickerChart, MeasuresEveryStepBetweenFrames) {
  const auto changes = MeasureFrames(
      "tiny-diffuse", {.width = 16, .height = 12, .budget = 120, .reference_samples = 16, .frames = 3},
      folder_, nullptr);
  ASSERT_TRUE(changes.ok()) << changes.status();
  ASSERT_EQ(changes->size(), 4u);
  EXPECT_EQ((*changes)[3].frame, 1);
  EXPECT_EQ((*changes)[1].reference.mean, 0) << "the camera stands still";
  EXPECT_GT((*changes)[1].uniform.mean, 0) << "and noise changes";
  for (const FrameChange& change : *changes) {
    if (!change.camera_turns) continue;
    for (const metrics::Flicker& flicker : {change.reference, change.uniform, change.adaptive}) {
      EXPECT_GT(flicker.mean, 0) << "the camera turns";
      EXPECT_GT(flicker.percentile99, flicker.mean);
    }
  }
}

TEST_F(FlickerChart, TakesGeneratedScenesOnly) {
  EXPECT_EQ(MeasureFrames("staircase", {}, folder_, nullptr).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(FlickerChart, WritesMeansAndTheirRatios) {
  const std::vector<FrameChange> changes = {{"room", false, 0, {0, 0}, {1, 2}, {2, 2}},
                                            {"room", true, 0, {1, 10}, {2, 20}, {3, 10}},
                                            {"room", true, 1, {2, 20}, {4, 30}, {2, 15}}};
  ASSERT_TRUE(ChartFlicker(folder_, changes, {.frames = 3}, {"the command", 1}).ok());
  const std::string page = ReadFile(folder_ + "/flicker.md", 1 << 20).value();
  EXPECT_THAT(page, HasSubstr("| room | turns | mean | 1.500 | 3.000 | 2.500 | 1.000 ± 0.500 |"));
  EXPECT_THAT(page, HasSubstr("| room | turns | 99th percentile | 15.000 | 25.000 | 12.500 | 0.500 |"));
  EXPECT_THAT(page, HasSubstr("| room | stands still | mean | 0.000 | 1.000 | 2.000 | 2.000 |"));
  EXPECT_THAT(ReadFile(folder_ + "/flicker.csv", 1 << 20).value(), HasSubstr("room,1,1,2,20,4,30,2,15"));
}

}  // namespace
}  // namespace lumifold::charts
