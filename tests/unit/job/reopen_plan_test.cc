#include "server/job/reopen_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/job/gaps.h"
#include "server/job/job_spec.h"

namespace lumifold::job {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// 3 x 2 tiles, 3 passes of 4, 4 and 2 samples, frames 1, 2, 3 and 7.
ReopenedJob Job(v1::JobState state, std::vector<int32_t> finished) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(20);
  spec.set_height(12);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(10);
  spec.set_pass_samples(4);
  spec.set_first_frame(1);
  spec.set_frame_count(3);
  return {.spec = *NormaliseJobSpec(spec),
          .state = state,
          .frames = {1, 2, 3, 7},
          .finished = std::move(finished)};
}

const std::vector<int32_t> kAll = {1, 2, 3, 7};

UnitKey Pass(int32_t frame, int32_t tile, int32_t pass) { return {frame, tile, pass, v1::UNIT_KIND_PASS}; }
UnitKey Geometry(int32_t frame, int32_t tile) { return {frame, tile, 0, v1::UNIT_KIND_GEOMETRY}; }

ReopenPlan Make(const ReopenedJob& job, const ReopenRequest& request) {
  absl::StatusOr<ReopenPlan> plan = ReopenPlan::Make(job, request);
  EXPECT_TRUE(plan.ok()) << plan.status();
  return *std::move(plan);
}

TEST(ReopenPlan, MoreSamplesKeepAllUnitsWithTheSameSamples) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_DONE, kAll), {.samples_per_pixel = 21});
  EXPECT_THAT(plan.frames(), ElementsAre(1, 2, 3, 7));
  EXPECT_THAT(plan.frames_that_need_film(), IsEmpty());
  EXPECT_EQ(plan.spec().samples_per_pixel(), 21);
  EXPECT_EQ(plan.spec().pass_samples(), 4);
  EXPECT_TRUE(plan.Keeps(Geometry(2, 5)));
  EXPECT_TRUE(plan.Keeps(Pass(7, 5, 0)));
  EXPECT_TRUE(plan.Keeps(Pass(7, 5, 1)));
  EXPECT_FALSE(plan.Keeps(Pass(7, 5, 2)));  // two samples before, four now
  EXPECT_FALSE(plan.Keeps(Pass(7, 5, 3)));
  EXPECT_FALSE(plan.Keeps(Pass(4, 5, 0)));
}

TEST(ReopenPlan, AWholeNumberOfPassesMoreKeepsEverything) {
  ReopenedJob job = Job(v1::JOB_STATE_DONE, kAll);
  job.spec.set_samples_per_pixel(12);
  const ReopenPlan plan = Make(job, {.samples_per_pixel = 16});
  for (int32_t pass = 0; pass < 3; ++pass) EXPECT_TRUE(plan.Keeps(Pass(1, 0, pass)));
}

TEST(ReopenPlan, AddingSamplesTwiceChangesNothing) {
  EXPECT_TRUE(Make(Job(v1::JOB_STATE_DONE, kAll), {.samples_per_pixel = 10}).ChangesNothing());
  EXPECT_TRUE(Make(Job(v1::JOB_STATE_RUNNING, {1}), {.samples_per_pixel = 10}).ChangesNothing());
}

TEST(ReopenPlan, FewerSamplesAndTooManyAreRefused) {
  const absl::Status fewer =
      ReopenPlan::Make(Job(v1::JOB_STATE_DONE, kAll), {.samples_per_pixel = 9}).status();
  EXPECT_EQ(fewer.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(fewer.message()), HasSubstr("samples_per_pixel is 9, but the job has 10"));
  const absl::Status more =
      ReopenPlan::Make(Job(v1::JOB_STATE_DONE, kAll), {.samples_per_pixel = 2'000'000}).status();
  EXPECT_EQ(more.code(), absl::StatusCode::kInvalidArgument);
}

TEST(ReopenPlan, AFailedJobGoesOnWithEverythingItHas) {
  for (const v1::JobState state : {v1::JOB_STATE_FAILED, v1::JOB_STATE_CANCELLED}) {
    const ReopenPlan plan = Make(Job(state, {1, 3}), {});
    EXPECT_THAT(plan.frames(), ElementsAre(2, 7));
    EXPECT_TRUE(plan.Keeps(Pass(2, 0, 2)));
    EXPECT_THAT(plan.frames_that_need_film(), IsEmpty());
  }
}

TEST(ReopenPlan, ADoneJobWithoutPartsIsRenderedAgainWholly) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_DONE, kAll), {});
  EXPECT_THAT(plan.frames(), ElementsAre(1, 2, 3, 7));
  EXPECT_FALSE(plan.Keeps(Geometry(1, 0)));
}

TEST(ReopenPlan, ARunningJobWithoutPartsGoesOn) {
  EXPECT_TRUE(Make(Job(v1::JOB_STATE_RUNNING, {1}), {}).ChangesNothing());
}

TEST(ReopenPlan, FramesThatAreNamedAreRenderedAgainAndUnfinishedOnesGoOn) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_FAILED, {1, 2}), {.frames = {2}});
  EXPECT_THAT(plan.frames(), ElementsAre(2, 3, 7));
  EXPECT_FALSE(plan.Keeps(Pass(2, 0, 0)));
  EXPECT_TRUE(plan.Keeps(Pass(3, 0, 0)));
}

TEST(ReopenPlan, ARegionIsTheTilesThatTouchIt) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_DONE, kAll), {.frames = {7}, .region = Rect{7, 0, 9, 5}});
  EXPECT_THAT(plan.frames(), ElementsAre(7));
  EXPECT_THAT(plan.frames_that_need_film(), ElementsAre(7));
  for (int32_t tile = 0; tile < 6; ++tile) {
    EXPECT_EQ(plan.Keeps(Geometry(7, tile)), tile > 1) << tile;
    EXPECT_EQ(plan.Keeps(Pass(7, tile, 2)), tile > 1) << tile;
  }
}

TEST(ReopenPlan, ARegionIsCutAtTheBorderAndRefusedOutside) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_DONE, kAll), {.region = Rect{19, 11, 500, 500}});
  EXPECT_FALSE(plan.Keeps(Pass(1, 5, 0)));
  EXPECT_TRUE(plan.Keeps(Pass(1, 4, 0)));
  for (const Rect& region : {Rect{20, 0, 30, 10}, Rect{5, 5, 5, 9}, Rect{-9, -9, 0, 0}}) {
    EXPECT_EQ(ReopenPlan::Make(Job(v1::JOB_STATE_DONE, kAll), {.region = region}).status().code(),
              absl::StatusCode::kInvalidArgument);
  }
}

TEST(ReopenPlan, FilterOnlyKeepsAllUnits) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_DONE, kAll), {.frames = {3}, .filter_only = true});
  EXPECT_THAT(plan.frames(), ElementsAre(3));
  EXPECT_THAT(plan.frames_that_need_film(), ElementsAre(3));
  EXPECT_TRUE(plan.Keeps(Pass(3, 0, 0)));
}

TEST(ReopenPlan, AFrameThatTheJobDoesNotHaveIsRefused) {
  const absl::Status status = ReopenPlan::Make(Job(v1::JOB_STATE_DONE, kAll), {.frames = {1, 5}}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("no frame 5"));
}

ReopenedJob WithGaps(ReopenedJob job, const std::vector<int32_t>& skipped) {
  SetSkipped(skipped, &job.gaps);
  return job;
}

TEST(ReopenPlan, TheFrameThatFailedTheJobIsSkippedAndFromThenOnAllThatFail) {
  ReopenedJob job = Job(v1::JOB_STATE_FAILED, {1});
  job.gaps.set_failed_frame(3);
  const ReopenPlan plan = Make(job, {.skip = true});
  EXPECT_FALSE(plan.ChangesNothing());
  EXPECT_THAT(plan.frames(), ElementsAre(2, 7));
  EXPECT_THAT(plan.forgotten_frames(), ElementsAre(2, 3, 7));
  EXPECT_EQ(TextOf(plan.gaps()), "3");
  EXPECT_TRUE(plan.gaps().skip_failed());
  EXPECT_FALSE(plan.gaps().has_failed_frame());
  EXPECT_TRUE(plan.Keeps(Pass(2, 0, 0)));
}

TEST(ReopenPlan, FramesToSkipAddUpAndFinishedOnesStay) {
  const ReopenPlan plan =
      Make(WithGaps(Job(v1::JOB_STATE_RUNNING, {1}), {7}), {.frames = {1, 2}, .skip = true});
  EXPECT_EQ(TextOf(plan.gaps()), "2,7");
  EXPECT_FALSE(plan.gaps().skip_failed());
  EXPECT_THAT(plan.frames(), ElementsAre(3));
  EXPECT_THAT(plan.forgotten_frames(), ElementsAre(2, 3));
}

TEST(ReopenPlan, ALastGapMayBeAllThatChanges) {
  const ReopenPlan plan = Make(Job(v1::JOB_STATE_FAILED, {1, 2, 3}), {.frames = {7}, .skip = true});
  EXPECT_FALSE(plan.ChangesNothing());
  EXPECT_THAT(plan.frames(), IsEmpty());
  EXPECT_THAT(plan.forgotten_frames(), ElementsAre(7));
}

TEST(ReopenPlan, SkippingWhatIsThereOrSkippedChangesNothing) {
  EXPECT_TRUE(Make(Job(v1::JOB_STATE_DONE, kAll), {.frames = {2}, .skip = true}).ChangesNothing());
  const ReopenedJob job = WithGaps(Job(v1::JOB_STATE_DONE_WITH_GAPS, {1, 3, 7}), {2});
  EXPECT_TRUE(Make(job, {.frames = {2}, .skip = true}).ChangesNothing());
}

TEST(ReopenPlan, NotAllFramesAreSkippedNorPartsOfFrames) {
  const ReopenedJob job = WithGaps(Job(v1::JOB_STATE_FAILED, {}), {2, 3});
  for (const ReopenRequest& request :
       {ReopenRequest{.frames = {1, 7}, .skip = true}, ReopenRequest{.filter_only = true, .skip = true},
        ReopenRequest{.region = Rect{0, 0, 1, 1}, .skip = true}}) {
    EXPECT_EQ(ReopenPlan::Make(job, request).status().code(), absl::StatusCode::kInvalidArgument);
  }
}

TEST(ReopenPlan, AJobWithGapsGoesOnWithThem) {
  ReopenedJob job = WithGaps(Job(v1::JOB_STATE_DONE_WITH_GAPS, {1, 3}), {2, 7});
  job.gaps.set_skip_failed(true);
  const ReopenPlan all = Make(job, {});
  EXPECT_THAT(all.frames(), ElementsAre(2, 7));
  EXPECT_EQ(TextOf(all.gaps()), "");
  EXPECT_FALSE(all.gaps().skip_failed());
  const ReopenPlan one = Make(job, {.frames = {3, 7}});
  EXPECT_THAT(one.frames(), ElementsAre(3, 7));
  EXPECT_EQ(TextOf(one.gaps()), "2");
  EXPECT_TRUE(one.gaps().skip_failed());
}

TEST(ReopenPlan, OtherChangesLeaveGaps) {
  const ReopenedJob job = WithGaps(Job(v1::JOB_STATE_DONE_WITH_GAPS, {1, 3, 7}), {2});
  for (const ReopenRequest& request :
       {ReopenRequest{.samples_per_pixel = 20}, ReopenRequest{.filter_only = true},
        ReopenRequest{.region = Rect{0, 0, 1, 1}}}) {
    const ReopenPlan plan = Make(job, request);
    EXPECT_THAT(plan.frames(), ElementsAre(1, 3, 7));
    EXPECT_EQ(TextOf(plan.gaps()), "2");
  }
}

// The summary of a frame agrees with its units.
TEST(ReopenPlan, WhatIsKeptOfAFrameIsKeptOfItsUnits) {
  const ReopenRequest requests[] = {{},
                                    {.samples_per_pixel = 12},
                                    {.frames = {2}},
                                    {.frames = {2}, .region = Rect{0, 0, 1, 1}},
                                    {.filter_only = true}};
  for (const ReopenRequest& request : requests) {
    for (const int samples : {8, 10}) {
      ReopenedJob job = Job(v1::JOB_STATE_DONE, kAll);
      job.spec.set_samples_per_pixel(samples);
      const ReopenPlan plan = Make(job, request);
      const FrameUnits units(job.spec);
      for (const int32_t frame : plan.frames()) {
        int64_t kept = 0;
        for (int64_t number = 0; number < units.count(); ++number)
          kept += plan.Keeps(units.KeyOf(frame, number));
        const auto expected = kept == 0               ? ReopenPlan::Kept::kNone
                              : kept == units.count() ? ReopenPlan::Kept::kAll
                                                      : ReopenPlan::Kept::kSome;
        EXPECT_EQ(plan.KeptOf(frame), expected) << samples;
      }
    }
  }
}

// A unit may be kept only if both specs have it with the same samples, whatever the sizes.
TEST(ReopenPlan, WhatIsKeptHasTheSameSamplesInBothSpecs) {
  for (int before = 1; before <= 13; ++before) {
    for (int after = before + 1; after <= 26; ++after) {
      ReopenedJob job = Job(v1::JOB_STATE_DONE, kAll);
      job.spec.set_samples_per_pixel(before);
      const ReopenPlan plan = Make(job, {.samples_per_pixel = after});
      const FrameUnits units(plan.spec());
      int kept = 0;
      for (int64_t number = 0; number < units.count(); ++number) {
        const UnitKey key = units.KeyOf(1, number);
        if (key.tile != 0 || key.kind != v1::UNIT_KIND_PASS || !plan.Keeps(key)) continue;
        EXPECT_LE(units.SamplesOf(key).last, static_cast<uint32_t>(before));
        ++kept;
      }
      EXPECT_EQ(kept, before / 4) << before << " to " << after;
    }
  }
}

}  // namespace
}  // namespace lumifold::job
