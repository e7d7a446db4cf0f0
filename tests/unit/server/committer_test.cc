#include "server/commit/committer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>
#include <spdlog/logger.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "tests/unit/server/committed_frame_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;

const job::JobId kWritten("j-1");

/// A committer whose clock moves on by a microsecond with each look at it.
class CommitterTest : public CommittedFrameFixture, public Committer::Listener {
 protected:
  CommitterTest() {
    committer_ = std::make_unique<Committer>(
        CommitterOptions{
            .epoch = {},
            .now = [this] { return absl::UnixEpoch() + absl::Microseconds(++looks_); },
            .storage = {.pauses = {.first = absl::Microseconds(4), .longest = absl::Microseconds(16)}}},
        folder_, store_.get(), &storage_, &timings_, this);
  }

  bool IsWanted(const job::JobId&) override { return true; }
  void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) override {
    EXPECT_TRUE(status.ok()) << status;
    absl::MutexLock lock(&mutex_);
    for (const AcceptedUnit& unit : units) record_bytes_.push_back(unit.record_bytes);
  }
  void OnUnitsLost(const job::JobId&, int32_t, const absl::Status&,
                   const absl::StatusOr<std::vector<ledger::UnitRecord>>&) override {}
  void OnUnitsDiscarded(const FrameKey&, const std::vector<job::UnitKey>&,
                        const absl::StatusOr<std::vector<ledger::UnitRecord>>&) override {}
  void OnStorageAvailable() override {
    absl::MutexLock lock(&mutex_);
    ++recoveries_;
  }

  /// Looks at the clock between the tries of an order that fails so often.
  std::vector<int64_t> PausesOf(int failures) {
    std::vector<int64_t> tries;
    absl::Notification done;
    committer_->Write(
        [&] {
          tries.push_back(looks_);
          return static_cast<int>(tries.size()) > failures ? absl::OkStatus()
                                                           : absl::UnavailableError("full");
        },
        [&](const absl::Status& status) {
          EXPECT_TRUE(status.ok()) << status;
          done.Notify();
        });
    done.WaitForNotification();
    std::vector<int64_t> pauses;
    for (size_t i = 1; i < tries.size(); ++i) pauses.push_back(tries[i] - tries[i - 1] - 1);
    return pauses;
  }

  std::atomic<int64_t> looks_{0};
  StorageState storage_{[] { return absl::UnixEpoch(); }, std::make_shared<spdlog::logger>("none")};
  monitoring::FarmTimings timings_;
  absl::Mutex mutex_;
  int recoveries_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<uint64_t> record_bytes_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<Committer> committer_;  // last: its thread uses the members above
};

TEST_F(CommitterTest, PausesGrowWithErrorsAndAreShortAgainAfterASuccess) {
  committer_->Start();
  EXPECT_THAT(PausesOf(5), ElementsAre(4, 8, 16, 16, 16));
  {
    absl::MutexLock lock(&mutex_);
    const auto has_recovered = [this]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return recoveries_ > 0; };
    mutex_.Await(absl::Condition(&has_recovered));
  }
  EXPECT_THAT(PausesOf(2), ElementsAre(4, 8));
}

TEST_F(CommitterTest, EachRecordIsAsLongAsItsUnitAndFollowsTheLast) {
  const v1::JobSpec spec = Spec(16, 8);
  ASSERT_TRUE(
      store_->CreateJob({.id = kWritten, .request_id = "r", .spec = spec, .submitted = absl::Now()}).ok());
  const job::FrameUnits frame(spec);
  std::vector<uint64_t> sizes;
  for (int64_t i = 0; i < 3; ++i) {
    const job::UnitKey key = frame.KeyOf(0, i);
    film::StoredUnit unit{{kWritten, key},
                          job::Attempt(1),
                          {},
                          RandomUnit(key, frame.tiles().RectOf(key.tile), frame.SamplesOf(key), 1)};
    unit.stats.set_bad_samples(10 + i);
    AcceptedUnit accepted;
    accepted.stored = Encoded(unit);
    accepted.worker_name = "ann";
    accepted.samples = 20 + i;
    accepted.numeric_class = "c";
    accepted.started = absl::FromUnixSeconds(70 + i);
    sizes.push_back(accepted.stored.size_bytes());
    committer_->Enqueue(std::move(accepted));
  }
  committer_->Start();
  committer_->Stop();  // after what is queued
  {
    absl::MutexLock lock(&mutex_);
    EXPECT_EQ(record_bytes_, sizes);
  }
  EXPECT_EQ(std::filesystem::file_size(folder_.PathOf(folder_.UnitLogName(kWritten, 0))),
            sizes[0] + sizes[1] + sizes[2]);
  for (int64_t i = 0; i < 3; ++i) {
    bool is_found = false;
    const absl::Status read = store_->ForEachUnit(kWritten, 0, [&](const ledger::UnitRecord& record) {
      if (!(record.unit.key == frame.KeyOf(0, i))) return;
      is_found = true;
      EXPECT_EQ(record.length, sizes[static_cast<size_t>(i)]);
      EXPECT_EQ(record.offset, (i > 0 ? sizes[0] : 0) + (i > 1 ? sizes[1] : 0));
      EXPECT_EQ(record.worker, "ann");
    });
    EXPECT_TRUE(read.ok() && is_found) << i;
  }
  const ledger::JobRecord job = *store_->GetJob(kWritten);
  EXPECT_EQ(job.done.units, 3);
  EXPECT_EQ(job.numeric_class, "c");
  EXPECT_EQ(job.started, absl::FromUnixSeconds(70)) << "of the first unit";
  EXPECT_EQ(job.done.samples, 20 + 21 + 22);
  EXPECT_EQ(job.done.bad_samples, 10 + 11 + 12);
  for (const prometheus::MetricFamily& family : timings_.source()->Collect()) {
    const prometheus::ClientMetric::Histogram& times = family.metric.front().histogram;
    if (family.name != "lumifold_ledger_commit_seconds") continue;
    EXPECT_EQ(times.sample_count, 1u) << "one transaction";
    EXPECT_NEAR(times.sample_sum, 1e-6, 1e-9) << "from one look at the clock to the next";
  }
}

}  // namespace
}  // namespace lumifold::server
