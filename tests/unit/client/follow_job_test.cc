#include "client/farm/follow_job.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/client/fake_farm.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

v1::JobStatus FollowedJob(v1::JobState state, int64_t samples_done = 0) {
  v1::JobStatus job;
  job.set_job_id("job-1");
  job.set_state(state);
  job.set_samples_done(samples_done);
  job.set_samples_total(100);
  return job;
}

class FollowJobTest : public testing::Test {
 protected:
  absl::StatusOr<v1::JobStatus> Follow(const std::string& address) {
    return Follow(address, [this](const v1::JobStatus& job) {
      seen_.push_back(job.state());
      if (interrupt_at_ == job.state()) test_.interrupted = true;
    });
  }
  absl::StatusOr<v1::JobStatus> Follow(const std::string& address,
                                       absl::FunctionRef<void(const v1::JobStatus&)> on_status) {
    const auto client = ConnectTo({.coordinators = {address},
                                   .time = time_.Environment(),
                                   .interrupted = test_.environment.interrupted});
    QuietProgress progress(test_.err);
    return FollowJob(*client, "job-1", progress,
                     Backoff(absl::Minutes(1), time_.Environment(), test_.environment.interrupted),
                     on_status);
  }

  FakeFarm farm_;
  TestEnvironment test_;
  FakeTime time_;
  std::vector<v1::JobState> seen_;
  v1::JobState interrupt_at_ = v1::JOB_STATE_UNSPECIFIED;
};

TEST_F(FollowJobTest, SaysWhereNobodyAnswersWithoutWaiting) {
  std::string address;
  {
    const FakeFarm gone;
    address = gone.address();
  }
  EXPECT_EQ(Follow(address).status(),
            absl::UnavailableError("cannot reach the coordinator at " + address + ": Connection refused"));
  EXPECT_LT(time_.now - absl::UnixEpoch(), absl::Seconds(1));
}

TEST_F(FollowJobTest, SaysThatThereIsNoSuchJob) {
  EXPECT_EQ(Follow(farm_.address()).status(), absl::NotFoundError("no job 'job-1'"));
}

TEST_F(FollowJobTest, GivesTheLastStatusWhateverTheFate) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_PLANNED), FollowedJob(v1::JOB_STATE_RUNNING, 50),
                   FollowedJob(v1::JOB_STATE_FAILED, 50)};
  farm_.watched.back().set_error("no memory");
  const auto job = Follow(farm_.address());
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->error(), "no memory");
  EXPECT_THAT(seen_, ElementsAre(v1::JOB_STATE_PLANNED, v1::JOB_STATE_RUNNING, v1::JOB_STATE_FAILED));
}

TEST_F(FollowJobTest, ComesBackWhenTheConnectionBreaks) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_RUNNING, 10), FollowedJob(v1::JOB_STATE_RUNNING, 20),
                   FollowedJob(v1::JOB_STATE_DONE, 100)};
  farm_.watched_per_stream = 1;
  const auto job = Follow(farm_.address());
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(test_.err.str(), HasSubstr("; trying again\n"));
}

TEST_F(FollowJobTest, LosesPatienceInTheEnd) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_RUNNING, 10), FollowedJob(v1::JOB_STATE_DONE, 100)};
  farm_.watched_per_stream = 1;
  const absl::Time begin = time_.now;
  // After the first status the stream breaks at once, every time.
  const auto job = Follow(farm_.address(), [this](const v1::JobStatus&) { farm_.watched_per_stream = 0; });
  EXPECT_EQ(job.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_GE(time_.now - begin, absl::Minutes(1));
}

TEST_F(FollowJobTest, HasAllItsPatienceAfterAJobThatDidNotChangeForLong) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_PAUSED), FollowedJob(v1::JOB_STATE_DONE, 100)};
  farm_.watched_per_stream = 1;
  const auto job = Follow(farm_.address(), [this](const v1::JobStatus&) { time_.now += absl::Hours(8); });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_DONE);
}

TEST_F(FollowJobTest, OpensAStreamAgainThatWasSilentUntilItsDeadlineWithoutAWord) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_PAUSED), FollowedJob(v1::JOB_STATE_DONE, 100)};
  farm_.watched_per_stream = 1;
  farm_.broken_watch = grpc::StatusCode::DEADLINE_EXCEEDED;
  const auto job = Follow(farm_.address());
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(test_.err.str(), "");
}

TEST_F(FollowJobTest, SaysEachWarningOnce) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_RUNNING), FollowedJob(v1::JOB_STATE_DONE)};
  for (v1::JobStatus& job : farm_.watched) job.add_warnings("the scene has no light");
  ASSERT_TRUE(Follow(farm_.address()).ok());
  EXPECT_EQ(test_.err.str(), "warning: the scene has no light\n");
}

TEST_F(FollowJobTest, StopsWhenTheUserInterruptsThoughTheCoordinatorIsSilent) {
  farm_.watched = {FollowedJob(v1::JOB_STATE_RUNNING)};
  farm_.hold_watch = true;
  interrupt_at_ = v1::JOB_STATE_RUNNING;
  EXPECT_EQ(Follow(farm_.address()).status(), absl::CancelledError("interrupted"));
}

TEST(ProgressOf, ShowsTheShareOfATime) {
  v1::JobStatus job = FollowedJob(v1::JOB_STATE_RUNNING, 30);
  job.mutable_adaptive()->set_time_seconds(60);
  job.mutable_times()->set_render_seconds(15);
  EXPECT_EQ(ProgressOf(job).done, 15'000);
  EXPECT_EQ(ProgressOf(job).total, 60'000);
  EXPECT_EQ(ProgressOf(job).unit, ProgressUnit::kTime);
  job.mutable_times()->set_render_seconds(61);
  EXPECT_EQ(ProgressOf(job).done, 60'000);
}

TEST(ProgressOf, CountsSamplesWhileRenderingAlone) {
  EXPECT_EQ(ProgressOf(FollowedJob(v1::JOB_STATE_RUNNING, 30)).done, 30);
  EXPECT_EQ(ProgressOf(FollowedJob(v1::JOB_STATE_RUNNING, 30)).total, 100);
  EXPECT_EQ(ProgressOf(FollowedJob(v1::JOB_STATE_PLANNED)).total, 0);
  EXPECT_EQ(ProgressOf(FollowedJob(v1::JOB_STATE_FILTERING, 100)).total, 0);
  v1::JobStatus filtering = FollowedJob(v1::JOB_STATE_FILTERING, 100);
  EXPECT_EQ(ProgressOf(filtering).stage, "filtering");
  filtering.set_frames_filtering(2);
  EXPECT_EQ(ProgressOf(filtering).note, "") << "of one frame there is nothing to tell";
  filtering.set_frames_filtered(0.25);
  filtering.set_frames_total(1);
  EXPECT_EQ(ProgressOf(filtering).done, 250);
  EXPECT_EQ(ProgressOf(filtering).total, 1000);
  filtering.set_frames_done(8);
  filtering.set_frames_skipped(2);
  filtering.set_frames_total(12);
  EXPECT_EQ(ProgressOf(filtering).done, 8250);
  EXPECT_EQ(ProgressOf(filtering).total, 10000);
  EXPECT_EQ(ProgressOf(filtering).note, "2 in the filter");
  filtering.set_frames_waiting(4);
  EXPECT_EQ(ProgressOf(filtering).note, "2 in the filter, 4 waiting");
}

}  // namespace
}  // namespace lumifold::client
