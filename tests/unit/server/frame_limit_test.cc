#include "server/coordinator/frame_limit.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <memory>

#include "absl/synchronization/mutex.h"
#include "server/commit/open_logs.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

constexpr uint64_t kMany = uint64_t{1} << 50;

TEST(FrameLimit, IsTheScarcestOfLogsDiskAndMemory) {
  const FrameDemand frame = {.log_bytes = 1 << 20, .units = 1000};
  EXPECT_EQ(MaxActiveFrames({.open_logs = 64, .free_disk_bytes = kMany, .memory_bytes = kMany}, frame), 64);
  EXPECT_EQ(MaxActiveFrames({.open_logs = 64, .free_disk_bytes = 20 << 20, .memory_bytes = kMany}, frame),
            10);
  EXPECT_EQ(
      MaxActiveFrames({.open_logs = 64, .free_disk_bytes = kMany, .memory_bytes = 3 * 64'000 * 16}, frame),
      3);
  EXPECT_EQ(MaxActiveFrames({.open_logs = 64, .free_disk_bytes = kMany, .memory_bytes = 5 * 64 * 16},
                            {.log_bytes = 1, .units = 1}),
            5);
}

TEST(FrameLimit, IsNeverBelowOne) {
  EXPECT_EQ(MaxActiveFrames({.open_logs = 1, .free_disk_bytes = 0, .memory_bytes = 0},
                            {.log_bytes = kMany, .units = 1}),
            1);
}

TEST(FrameLimit, AQuarterOfTheDescriptorsIsForLogs) {
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit low = {200, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  EXPECT_EQ(MaxOpenLogs(), 50u);
  setrlimit(RLIMIT_NOFILE, &before);
}

TEST(OpenLogs, ClosesTheOneThatWasUsedLeastRecently) {
  TempFolder folder;
  OpenLogs logs(2);
  std::vector<int32_t> opened;
  const auto use = [&](int32_t frame) {
    const auto log = logs.Get({job::JobId("j-1"), frame}, [&] {
      opened.push_back(frame);
      return film::UnitLog::Open(folder.PathOf(std::to_string(frame)), 0);
    });
    ASSERT_TRUE(log.ok()) << log.status();
  };
  for (const int32_t frame : {1, 2, 1, 3, 1, 2}) use(frame);
  EXPECT_EQ(opened, (std::vector<int32_t>{1, 2, 3, 2}));
  logs.CloseAll(job::JobId("j-1"));
  use(2);
  EXPECT_EQ(opened.size(), 5u);
}

/// Finishes frames without a result, and only when no unit is being rendered any more: so frames pile up
/// before it.
class SlowFinisher final : public FrameFinisher {
 public:
  absl::StatusOr<v1::FrameReport> Finish(const ledger::OwnedJob&, int32_t, int, const std::vector<int>&,
                                         const FilterProgress&) override {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &SlowFinisher::MayFinish));
    --allowed_;
    return v1::FrameReport();
  }
  absl::StatusOr<v1::FrameReport> Filter(const ledger::OwnedJob& owned, int32_t frame, int,
                                         int threads) override {
    return Finish(owned, frame, threads, {}, nullptr);
  }
  absl::StatusOr<v1::FrameReport> Estimate(const RoundToEstimate& round, int threads) override {
    return Finish({round.job, round.epoch}, round.frame, threads, {}, nullptr);
  }
  void CancelJob(const job::JobId&) override {}
  void Cancel() override { Allow(1'000'000); }
  void Allow(int frames) {
    absl::MutexLock lock(&mutex_);
    allowed_ = frames;
  }

 private:
  bool MayFinish() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return allowed_ > 0; }

  absl::Mutex mutex_;
  int allowed_ ABSL_GUARDED_BY(mutex_) = 0;
};

class FramesInFlightTest : public CoordinatorFixture {};

TEST_F(FramesInFlightTest, ManyMoreFramesThanDescriptorsEndWell) {
  constexpr int kFrames = 1500;
  rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit low = {256, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &low), 0);
  SlowFinisher* finisher = nullptr;
  make_finisher_ = [&] {
    auto made = std::make_unique<SlowFinisher>();
    finisher = made.get();
    return made;
  };
  options_.storage.max_open_logs = MaxOpenLogs();
  ASSERT_TRUE(Start().ok());
  v1::JobSpec spec = Spec();
  spec.set_frame_count(kFrames);
  const job::JobId job = Submit(spec);
  PumpedWorker worker(coordinator_.get(), 64);
  // The finisher waits: only as many frames are begun as may be in flight.
  while (worker.Deliver() > 0 || worker.acknowledged().size() < worker.leased().size())
    absl::SleepFor(absl::Milliseconds(1));
  EXPECT_LE(worker.leased().size(), 2 * options_.storage.max_open_logs);
  finisher->Allow(kFrames);
  const v1::JobStatus status = Finish(job, &worker);
  EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
  EXPECT_EQ(status.frames_done(), kFrames);
  setrlimit(RLIMIT_NOFILE, &before);
}

}  // namespace
}  // namespace lumifold::server
