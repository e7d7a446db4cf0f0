// The options of a picture: what a job gets of them, and the same again from a job's settings.
#include "client/options/job_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "client/reports/job_settings.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using ::testing::HasSubstr;

using Arguments = std::vector<std::string>;

class JobOptionsTest : public ::testing::Test {
 protected:
  JobOptionsTest() { scene_ = folder_.Write("room.gltf", R"({"asset":{"version":"2.0"}})"); }

  /// Nothing where the options are refused.
  std::optional<v1::JobSpec> SpecOf(Arguments arguments) {
    test_.err.str("");
    arguments.insert(arguments.begin(), scene_);
    JobOptions options;
    CommandLine command_line({"submit", "Submit", "submit a.glb"});
    AddJobOptions(command_line, &options);
    if (command_line.Parse(arguments, test_.environment).has_value()) return std::nullopt;
    if (CheckJobOptions("submit", test_.environment, &options).has_value()) return std::nullopt;
    return MakeJobSpec(options);
  }
  void ExpectTaken(const Arguments& arguments) { EXPECT_TRUE(SpecOf(arguments).has_value()) << Err(); }
  void ExpectRefused(const Arguments& arguments, const std::string& why) {
    EXPECT_FALSE(SpecOf(arguments).has_value()) << arguments.back();
    EXPECT_THAT(Err(), HasSubstr(why));
  }
  std::string Err() const { return test_.err.str(); }

  ScratchFolder folder_;
  TestEnvironment test_;
  std::string scene_;
};

/// What a coordinator tells of a job of this spec.
v1::JobStatus StatusOf(const v1::JobSpec& spec) {
  v1::JobStatus status;
  *status.mutable_settings() = spec;
  status.set_width(spec.width());
  status.set_height(spec.height());
  status.set_samples_per_pixel(spec.samples_per_pixel());
  status.set_first_frame(spec.first_frame());
  status.set_frame_count(spec.frame_count());
  *status.mutable_more_frames() = spec.more_frames();
  if (spec.has_adaptive()) *status.mutable_adaptive() = spec.adaptive();
  return status;
}

const Arguments kAllOptions = {"--size",
                               "200x100",
                               "--region",
                               "10,20,110,70",
                               "--pixel-filter",
                               "gaussian",
                               "--pixel-filter-width",
                               "2.5",
                               "--spp",
                               "16",
                               "--seed",
                               "18446744073709551615",
                               "--max-bounces",
                               "3",
                               "--method",
                               "none",
                               "--camera",
                               "top view",
                               "--animation",
                               "walk",
                               "--variant",
                               "red",
                               "--frames",
                               "3-5,8,10-11",
                               "--fps",
                               "12.5",
                               "--env",
                               "sky.exr",
                               "--env-rotate",
                               "-90",
                               "--env-scale",
                               "0.5",
                               "--ground",
                               "shadow",
                               "--f-stop",
                               "2.8",
                               "--focus",
                               "3",
                               "--save-film",
                               "--cryptomatte",
                               "--plan",
                               "full",
                               "--force",
                               "levels=1",
                               "--force",
                               "glossy=off"};

TEST_F(JobOptionsTest, EachIsInTheSpec) {
  const std::optional<v1::JobSpec> spec = SpecOf(kAllOptions);
  ASSERT_TRUE(spec.has_value()) << Err();
  EXPECT_EQ(spec->ShortDebugString(),
            "camera: \"top view\" width: 100 height: 50 first_frame: 3 frame_count: 3 samples_per_pixel: 16 "
            "seed: 18446744073709551615 max_bounces: 3 filter { method: \"none\" } save_film: true "
            "environment { uri: \"environment:sky.exr\" rotate_degrees: -90 scale: 0.5 } "
            "lens { f_stop: 2.8 focus_metres: 3 } frames_per_second: 12.5 more_frames { first: 8 count: 1 } "
            "more_frames { first: 10 count: 2 } "
            "planning { mode: PLAN_MODE_FULL forced: \"levels=1\" forced: \"glossy=off\" } "
            "crop { frame_width: 200 frame_height: 100 x: 10 y: 20 } "
            "pixel_filter { kind: PIXEL_FILTER_KIND_GAUSSIAN width: 2.5 } cryptomatte: true "
            "animation: \"walk\" variant: \"red\" background: BACKGROUND_TRANSPARENT ground: GROUND_SHADOW");
}

TEST_F(JobOptionsTest, TheSettingsOfAJobMakeTheSameJob) {
  for (const Arguments& arguments : {kAllOptions,
                                     Arguments{},
                                     {"--adaptive"},
                                     {"--target-error", "0.5", "--target-metric", "relmse"},
                                     {"--target-error", "12", "--spp", "100"},
                                     {"--time", "90s"},
                                     {"--schedule", "32,64.5", "--frame", "7"},
                                     {"--env", "none"},
                                     {"--env", "studio", "--env-scale", "2"},
                                     {"--background", "transparent"},
                                     {"--pixel-filter-width", "2"},
                                     {"--pixel-filter", "gaussian"},
                                     {"--pixel-filter", "blackman-harris"}}) {
    const std::optional<v1::JobSpec> spec = SpecOf(arguments);
    ASSERT_TRUE(spec.has_value()) << Err();
    const std::string file = folder_.Write("job.json", SettingsJson(StatusOf(*spec)).dump());
    const std::optional<v1::JobSpec> again = SpecOf({"--job", file});
    ASSERT_TRUE(again.has_value()) << Err();
    EXPECT_EQ(again->DebugString(), spec->DebugString());
  }
}

TEST_F(JobOptionsTest, SamplesDependOnWhatEndsTheJob) {
  EXPECT_EQ(SpecOf({})->samples_per_pixel(), 64);
  EXPECT_FALSE(SpecOf({})->has_adaptive());
  EXPECT_EQ(SpecOf({"--adaptive"})->samples_per_pixel(), 64);
  EXPECT_TRUE(SpecOf({"--adaptive"})->has_adaptive());
  for (const Arguments& limit : {Arguments{"--target-error", "1"}, {"--time", "1s"}, {"--schedule", "8"}}) {
    EXPECT_EQ(SpecOf(limit)->samples_per_pixel(), 4096) << limit[0];
    EXPECT_TRUE(SpecOf(limit)->has_adaptive()) << limit[0];
  }
  EXPECT_EQ(SpecOf({"--target-error", "1", "--spp", "5"})->samples_per_pixel(), 5);
}

TEST_F(JobOptionsTest, LimitsAreTakenAndWhatIsBeyondIsNot) {
  const auto expect = [&](const std::string& option, const Arguments& taken, const Arguments& refused) {
    for (const std::string& value : taken) ExpectTaken({"--size", "200x100", option, value});
    for (const std::string& value : refused) ExpectRefused({"--size", "200x100", option, value}, option);
  };
  expect("--spp", {"1", "1048576"}, {"0", "1048577"});
  expect("--max-bounces", {"0", "1024"}, {"-1", "1025"});
  expect("--max-file-mb", {"1", "1048576"}, {"0", "1048577"});
  expect("--max-job-mb", {"1", "1048576"}, {"0", "1048577"});
  expect("--schedule", {"1", "1048576", "2,3"}, {"0.99", "1048576.5", "2,x"});
  expect("--pixel-filter-width", {"8", "0.1"}, {"8.01", "0"});
  expect("--region", {"0,0,200,100"}, {"0,0,201,100", "0,0,200,101"});
  expect("--time", {"1ms", "10m"}, {"0s", "-1s", "inf", "10"});
  expect("--plan", {"auto", "full"}, {"none"});
  expect("--force", {"levels=0"}, {"levels=x", "nothing=1"});
}

TEST_F(JobOptionsTest, OptionsThatNeedOrForbidEachOther) {
  ExpectRefused({"--f-stop", "2"}, "must be given together");
  ExpectRefused({"--focus", "2"}, "must be given together");
  for (const Arguments& option : {Arguments{"--env-rotate", "90"}, {"--env-scale", "2"}}) {
    ExpectRefused(option, "require --env");
    ExpectRefused({"--env", "none", option[0], option[1]}, "require --env");
    ExpectTaken({"--env", "studio", option[0], option[1]});
  }
  ExpectRefused({"--target-metric", "relmse"}, "requires --target-error");
  ExpectRefused({"--target-error", "1", "--target-metric", "psnr"}, "must be mse255 or relmse");
  ExpectTaken({"--target-metric", "mse255"});
  ExpectRefused({"--time", "1m", "--schedule", "8"}, "each other's place");
  ExpectRefused({"--schedule", "8", "--frames", "1-2"}, "a job of its own");
  ExpectTaken({"--time", "1m", "--frames", "1-2"});
}

}  // namespace
}  // namespace lumifold::client
