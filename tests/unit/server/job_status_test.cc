#include "server/coordinator/job_status.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/filled_message.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;

/// A job of 5 frames, 2 x 2 tiles and 2 passes, each of whose figures is another number.
ledger::JobRecord ManyNumbers() {
  ledger::JobRecord record;
  record.id = job::JobId("j-1");
  v1::JobSpec& spec = record.spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(16);
  spec.set_height(15);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(8);
  spec.set_pass_samples(4);
  spec.set_first_frame(2);
  spec.set_frame_count(5);
  spec.mutable_scene()->set_display_name("room.glb");
  record.scheduling.set_user("ann");
  record.state = v1::JOB_STATE_FAILED;
  record.error = "broken";
  record.submitted = absl::FromUnixMillis(1'700'000'000'123);
  record.done.units = 21;
  record.done.samples = 22;
  record.done.bad_samples = 23;
  record.done.frames = 3;
  record.times.set_render_seconds(1.5);
  record.times.set_assemble_seconds(2.5);
  record.times.set_filter_seconds(3.5);
  record.times.set_write_seconds(4.5);
  record.warnings = {"no light"};
  record.warnings_left_out = 7;
  record.estimated_error = 0.25;
  return record;
}

TEST(JobStatus, DoesNotCountWhatIsSkipped) {
  ledger::JobRecord record = ManyNumbers();
  record.state = v1::JOB_STATE_DONE_WITH_GAPS;
  v1::FrameRange* const range = record.scheduling.mutable_gaps()->add_skipped();
  range->set_first(3);
  range->set_count(2);
  const v1::JobStatus status = StatusOfEndedJob(record);
  EXPECT_EQ(status.frames_skipped(), 2);
  EXPECT_EQ(status.frames_total(), 5);
  EXPECT_EQ(status.units_total(), 3 * 4 * 3);
  EXPECT_EQ(status.units_done(), status.units_total());
  EXPECT_EQ(status.samples_done(), 16 * 15 * 8 * 3);
}

TEST(JobStatus, HasEachSettingOfTheSpec) {
  ledger::JobRecord record;
  record.spec = FilledMessage<v1::JobSpec>(1);
  record.spec.clear_plan();  // it must be one of these tiles
  v1::JobSpec expected = record.spec;
  // What the status has elsewhere, and what says how the farm divides the job.
  for (const char* field : {"scene", "width", "height", "tile_size", "samples_per_pixel", "pass_samples",
                            "first_pass_samples", "first_frame", "frame_count", "more_frames", "adaptive"})
    expected.GetReflection()->ClearField(&expected, expected.GetDescriptor()->FindFieldByName(field));
  EXPECT_EQ(StatusOfEndedJob(record).settings().DebugString(), expected.DebugString());
}

TEST(JobStatus, OfAnEndedJobIsItsRow) {
  ledger::JobRecord record = ManyNumbers();
  const v1::JobStatus status = StatusOfEndedJob(record);
  EXPECT_EQ(status.job_id(), "j-1");
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(status.error(), "broken");
  EXPECT_EQ(status.units_done(), 21);
  EXPECT_EQ(status.units_total(), 5 * 4 * 3);
  EXPECT_EQ(status.samples_done(), 22);
  EXPECT_EQ(status.samples_total(), 16 * 15 * 8 * 5);
  EXPECT_EQ(status.bad_samples(), 23);
  EXPECT_EQ(status.frames_done(), 3);
  EXPECT_EQ(status.frames_total(), 5);
  EXPECT_EQ(status.times().SerializeAsString(), record.times.SerializeAsString());
  EXPECT_EQ(status.submitted_unix_ms(), 1'700'000'000'123);
  EXPECT_THAT(std::vector<std::string>(status.warnings().begin(), status.warnings().end()),
              ElementsAre("no light", testing::StartsWith("7 further warnings")));
  EXPECT_EQ(status.estimated_error(), 0.25);
  EXPECT_EQ(status.scheduling().user(), "ann");
  EXPECT_EQ(status.display_name(), "room.glb");
  EXPECT_EQ(status.width(), 16);
  EXPECT_EQ(status.height(), 15);
  EXPECT_EQ(status.samples_per_pixel(), 8);
  EXPECT_EQ(status.first_frame(), 2);
  EXPECT_EQ(status.frame_count(), 5);
  EXPECT_EQ(status.workers(), 0);
  record.scheduling.set_name("the room");
  EXPECT_EQ(StatusOfEndedJob(record).display_name(), "the room");
  record.state = v1::JOB_STATE_DONE;
  EXPECT_EQ(StatusOfEndedJob(record).units_done(), 5 * 4 * 3);
  EXPECT_EQ(StatusOfEndedJob(record).samples_done(), 16 * 15 * 8 * 5);
  record.spec.mutable_adaptive();  // those that were made are all
  EXPECT_EQ(StatusOfEndedJob(record).units_total(), 21);
  EXPECT_EQ(StatusOfEndedJob(record).units_done(), 21);
  EXPECT_EQ(StatusOfEndedJob(record).samples_total(), 22);
  record.state = v1::JOB_STATE_CANCELLED;
  EXPECT_EQ(StatusOfEndedJob(record).samples_total(), 16 * 15 * 8 * 5);
}

TEST(JobStatus, OfAnActiveJobHasTheNumbersOfTheScheduler) {
  scheduler::JobProgress progress;
  progress.state = v1::JOB_STATE_RUNNING;
  progress.units_done = 31;
  progress.units_total = 32;
  progress.samples_done = 33;
  progress.frames_done = 4;
  progress.workers = 6;
  const ledger::JobRecord record = ManyNumbers();
  const v1::JobStatus status = StatusOfActiveJob(record, progress, /*waits=*/false);
  EXPECT_EQ(status.state(), v1::JOB_STATE_RUNNING);
  EXPECT_EQ(status.units_done(), 31);
  EXPECT_EQ(status.units_total(), 32);
  EXPECT_EQ(status.samples_done(), 33);
  EXPECT_EQ(status.frames_done(), 4);
  EXPECT_EQ(status.workers(), 6);
  EXPECT_EQ(status.bad_samples(), 23) << "of the row";
  EXPECT_EQ(status.times().filter_seconds(), 3.5);
  EXPECT_EQ(StatusOfActiveJob(record, progress, /*waits=*/true).state(), v1::JOB_STATE_SUBMITTED);
}

/// The states that clients see, by what holds a job up and whether it has begun.
TEST(JobStatus, ItsStateTellsWhyAJobRestsAndWhatItHas) {
  struct Case {
    bool user_paused, waits, scheduler_pauses, has_begun, needs_plan;
    v1::JobState expected;
  };
  for (const Case& c : {
           Case{false, false, false, false, false, v1::JOB_STATE_PLANNED},
           {false, false, false, true, false, v1::JOB_STATE_RUNNING},
           {true, false, true, false, false, v1::JOB_STATE_PAUSED},
           {true, false, true, true, false, v1::JOB_STATE_PAUSED},
           {false, false, true, false, false, v1::JOB_STATE_PLANNED},  // for a file
           {false, false, true, true, false, v1::JOB_STATE_RUNNING},
           {false, false, true, false, true, v1::JOB_STATE_SUBMITTED},
           {true, false, true, false, true, v1::JOB_STATE_PAUSED},
           {false, true, true, false, false, v1::JOB_STATE_SUBMITTED},
           {true, true, true, false, false, v1::JOB_STATE_SUBMITTED},
       }) {
    ledger::JobRecord record = ManyNumbers();
    if (c.needs_plan) record.spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
    record.scheduling.set_paused(c.user_paused);
    record.done.units = c.has_begun ? 1 : 0;
    scheduler::JobProgress progress;
    progress.units_done = record.done.units;
    progress.state = c.scheduler_pauses ? v1::JOB_STATE_PAUSED
                     : c.has_begun      ? v1::JOB_STATE_RUNNING
                                        : v1::JOB_STATE_PLANNED;
    EXPECT_EQ(StateOfActiveJob(record, progress, c.waits), c.expected)
        << c.user_paused << c.waits << c.scheduler_pauses << c.has_begun << c.needs_plan;
    if (c.waits) continue;  // the row does not tell
    record.state = v1::JOB_STATE_SUBMITTED;
    EXPECT_EQ(StatusOfRecord(record).state(), c.expected) << c.user_paused << c.has_begun << c.needs_plan;
    record.state = v1::JOB_STATE_CANCELLED;
    EXPECT_EQ(StatusOfRecord(record).state(), v1::JOB_STATE_CANCELLED);
  }
}

}  // namespace
}  // namespace lumifold::server
