// Finishing frames as a stage of the coordinator: retries, pauses and cancellation.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/null_sink.h>

#include <algorithm>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "proto/rpc/monotonic.h"
#include "server/assets/asset_store.h"
#include "server/coordinator/coordinator.h"
#include "server/finish/frame_finisher.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::HasSubstr;

const JobId kStagedJob("j-1");
const JobId kOther("j-2");

/// Fails as often as told, job by job.
class FailingFinisher final : public FrameFinisher {
 public:
  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob& owned, int32_t, int, const std::vector<int>&,
                                         const FilterProgress&) override {
    absl::MutexLock lock(&mutex_);
    const JobId& job = owned.job;
    tried_.push_back(job);
    if (hangs_) {
      mutex_.Await(absl::Condition(&cancelled_));
      return absl::CancelledError("the job has ended");
    }
    std::vector<absl::Status>& errors = errors_[job];
    if (errors.empty()) return v1::FrameReport();
    const absl::Status error = errors.back();
    errors.pop_back();
    return error;
  }
  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& owned, int32_t frame, int,
                                         int threads) override {
    return Finish(owned, frame, threads, {}, nullptr);
  }
  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    return Finish({round.job, round.epoch}, round.frame, threads, {}, nullptr);
  }
  void CancelJob(const JobId&) override {
    absl::MutexLock lock(&mutex_);
    cancelled_ = true;
  }
  void Cancel() override { CancelJob(kStagedJob); }

  void Fail(const JobId& job, int times, const absl::Status& error) {
    absl::MutexLock lock(&mutex_);
    errors_[job].assign(static_cast<size_t>(times), error);
  }
  void Hang() {
    absl::MutexLock lock(&mutex_);
    hangs_ = true;
  }
  std::vector<JobId> tried() {
    absl::MutexLock lock(&mutex_);
    return tried_;
  }

 private:
  absl::Mutex mutex_;
  bool hangs_ = false;
  bool cancelled_ = false;
  std::map<JobId, std::vector<absl::Status>> errors_;
  std::vector<JobId> tried_;
};

class FinisherStageTest : public CommittedFrameFixture {
 protected:
  void Start(int processes = 1, absl::Duration pause = absl::Milliseconds(1)) {
    CoordinatorOptions options;
    options.finishing.processes = processes;
    options.finishing.pause = pause;
    options.now = rpc::MonotonicNow;
    options.wall_now = [] { return absl::Now(); };
    options.random = [] { return uint64_t{1}; };
    options.log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>());
    coordinator_ = *Coordinator::Create(options, folder_, store_.get(), &assets_, &finisher_);
  }

  v1::JobStatus WaitForEnd(const JobId& job) {
    while (true) {
      v1::JobStatus status = *coordinator_->jobs().GetJob(job.value());
      if (status.state() != v1::JOB_STATE_FILTERING) return status;
      absl::SleepFor(absl::Milliseconds(5));
    }
  }

  AssetStore assets_{folder_.AssetsPath(), folder_.IncomingPath()};
  FailingFinisher finisher_;
  std::unique_ptr<Coordinator> coordinator_;
};

TEST_F(FinisherStageTest, AFrameWhoseProcessWasKilledIsTriedAgain) {
  Commit(kStagedJob, Spec(20, 12));
  finisher_.Fail(kStagedJob, 2, absl::InternalError("the filter process was ended by signal 9"));
  Start();
  EXPECT_EQ(WaitForEnd(kStagedJob).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(finisher_.tried(), testing::ElementsAre(kStagedJob, kStagedJob, kStagedJob));
}

TEST_F(FinisherStageTest, OthersDoNotWaitWhileAFrameIsToBeTriedAgain) {
  Commit(kStagedJob, Spec(20, 12));
  Commit(kOther, Spec(20, 12));
  finisher_.Fail(kStagedJob, 1, absl::InternalError("the filter process was ended by signal 9"));
  Start(/*processes=*/1, /*pause=*/absl::Hours(1));
  EXPECT_EQ(WaitForEnd(kOther).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(coordinator_->jobs().GetJob(kStagedJob.value())->state(), v1::JOB_STATE_FILTERING);
}

TEST_F(FinisherStageTest, AfterThreeFailuresTheJobFailsWithTheReason) {
  Commit(kStagedJob, Spec(20, 12));
  finisher_.Fail(kStagedJob, 9, absl::ResourceExhaustedError("out of memory"));
  Start();
  const v1::JobStatus status = WaitForEnd(kStagedJob);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(status.error(), "frame 0 failed 3 times: out of memory");
  EXPECT_EQ(finisher_.tried().size(), 3u);
}

TEST_F(FinisherStageTest, AnErrorThatWouldComeAgainFailsTheJobAtOnce) {
  Commit(kStagedJob, Spec(20, 12));
  finisher_.Fail(kStagedJob, 9, absl::InvalidArgumentError("no such method"));
  Start();
  EXPECT_EQ(WaitForEnd(kStagedJob).error(), "no such method");
  EXPECT_EQ(finisher_.tried().size(), 1u);
}

TEST_F(FinisherStageTest, ACancelledJobFreesTheFinisher) {
  Commit(kStagedJob, Spec(20, 12));
  finisher_.Hang();
  Start();
  while (finisher_.tried().empty()) absl::SleepFor(absl::Milliseconds(5));
  coordinator_->changes().CancelJob(kStagedJob.value(), [](const absl::StatusOr<v1::JobStatus>& status) {
    ASSERT_TRUE(status.ok()) << status.status();
    EXPECT_EQ(status->state(), v1::JOB_STATE_CANCELLED);
  });
  EXPECT_EQ(WaitForEnd(kStagedJob).state(), v1::JOB_STATE_CANCELLED);
  coordinator_->Shutdown();  // joins the finisher's thread, which is not in Finish any more
}

TEST_F(FinisherStageTest, AsManyFramesAsThereArePlacesAreFinishedAtATime) {
  Commit(kStagedJob, Spec(20, 12));
  Commit(kOther, Spec(20, 12));
  finisher_.Hang();
  Start(2);
  while (finisher_.tried().size() < 2) absl::SleepFor(absl::Milliseconds(5));
  EXPECT_THAT(finisher_.tried(), testing::UnorderedElementsAre(kStagedJob, kOther));
  v1::ExplainJobResponse explained = *coordinator_->jobs().ExplainJob(kOther.value());
  EXPECT_TRUE(std::any_of(explained.reasons().begin(), explained.reasons().end(),
                          [](const v1::Reason& reason) { return reason.code() == "filter_running"; }));
  coordinator_->Shutdown();
}

TEST_F(FinisherStageTest, DamageThatNoRecordExplainsFailsTheJob) {
  Commit(kStagedJob, Spec(20, 12));
  finisher_.Fail(kStagedJob, 9, absl::DataLossError("ledger: something else"));
  Start();
  const v1::JobStatus status = WaitForEnd(kStagedJob);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(status.error(), HasSubstr("something else"));
}

}  // namespace
}  // namespace lumifold::server
