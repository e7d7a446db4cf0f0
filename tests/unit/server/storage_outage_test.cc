// Storage that cannot be written is never a job's error: what arrives waits, and goes on by itself.
#include <gmock/gmock.h>

#include <cerrno>
#include <filesystem>
#include <memory>

#include "absl/time/clock.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

class StorageOutageTest : public CoordinatorFixture {
 protected:
  StorageOutageTest() {
    wrap_store_ = [this](std::unique_ptr<ledger::JobStore> store) {
      return std::make_unique<FailingStore>(std::move(store), &fault_);
    };
    options_.storage.reserve_bytes = 1 << 20;
  }

  std::string UndisturbedResult(int tiles) {
    EXPECT_TRUE(Start().ok());
    const job::JobId job = Submit(Spec(tiles), "undisturbed");
    PumpedWorker worker(coordinator_.get(), 3);
    EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
    return Result(job);
  }

  void AwaitOutage() {
    Await([this] { return !coordinator_->resources().storage.ok(); });
  }

  int CountInLog(const std::string& event) const {
    int count = 0;
    const std::string log = log_.str();
    for (size_t at = log.find(event); at != std::string::npos; at = log.find(event, at + 1)) ++count;
    return count;
  }

  uint64_t ReserveBytes() const { return std::filesystem::file_size(data_.ReservePath()); }

  FailingStore::Fault fault_;
};

TEST_F(StorageOutageTest, UnitsThatFindTheDiskFullAreKeptAndCommittedWhenThereIsRoom) {
  const std::string expected = UndisturbedResult(4);
  const job::JobId job = Submit(Spec(4));
  auto worker = std::make_unique<PumpedWorker>(coordinator_.get(), 3);
  Deliver(worker.get(), 2);
  Await([&] { return worker->acknowledged().size() == 2; });
  files_.Fail(ENOSPC);
  Deliver(worker.get(), 3);
  AwaitOutage();
  EXPECT_LE(worker->leases(), 3) << "nothing is leased but what was before the outage showed";
  EXPECT_EQ(worker->acknowledged().size(), 2u);
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_RUNNING);
  const absl::Status refused = TrySubmit(Spec(5), "refused").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("No space left on device"));
  EXPECT_EQ(coordinator_->submissions().ReceiveAsset(Spec().scene().file(), "ann").status(),
            coordinator_->resources().storage.status());
  const v1::ServerStatus status = *coordinator_->jobs().GetServerStatus();
  EXPECT_THAT(status.storage_error(), HasSubstr("No space left on device"));
  EXPECT_GT(status.storage_error_since_unix_ms(), 0);
  EXPECT_GT(status.free_bytes(), 0u);
  files_.Heal();
  EXPECT_EQ(Finish(job, worker.get()).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker->leased().size(), 8u);
  EXPECT_EQ(Result(job), expected);
  EXPECT_EQ(coordinator_->jobs().GetServerStatus()->storage_error(), "");
  worker.reset();
  Stop();
  EXPECT_EQ(CountInLog("event=storage_unavailable"), 1);
  EXPECT_EQ(CountInLog("event=storage_available"), 1);
}

TEST_F(StorageOutageTest, AJobEndsWhenItsEndCanBeRecorded) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec());
  PumpedWorker worker(coordinator_.get(), 3);
  fault_.Set("EndJob");
  while (worker.Deliver() > 0 || fault_.count() == 0) absl::SleepFor(absl::Milliseconds(1));
  AwaitOutage();
  EXPECT_NE(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_DONE);
  fault_.Set("");
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

TEST_F(StorageOutageTest, ACancellationThatCannotBeRecordedSaysSoAndIsRecordedLater) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec());
  fault_.Set("EndJob");
  const absl::Status answer = Cancel(job);
  EXPECT_EQ(answer.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(answer.message()), HasSubstr("database or disk is full"));
  fault_.Set("");
  {
    PumpedWorker worker(coordinator_.get(), 1);
    EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_CANCELLED);
    EXPECT_EQ(worker.leased().size(), 0u);
  }
  Stop();
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(StorageOutageTest, AFrameWhoseResultFindsTheDiskFullWaitsHoweverOften) {
  const std::string expected = UndisturbedResult(2);
  const job::JobId job = Submit(Spec(2));
  PumpedWorker worker(coordinator_.get(), 3);
  const int64_t calls = files_.calls();
  files_.Fail(ENOSPC, "/results/");
  while (worker.Deliver() > 0 || worker.acknowledged().size() < 4) absl::SleepFor(absl::Milliseconds(1));
  // More tries than failures that a frame may have.
  Await([&] { return files_.calls() > calls + 30; });
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_FILTERING);
  files_.Heal();
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Result(job), expected);
}

TEST_F(StorageOutageTest, TheReserveIsGivenUpForTheLedgerAndTakenAgain) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(2));
  const job::JobId other = Submit(Spec(2), "other");
  PumpedWorker worker(coordinator_.get(), 1);
  Deliver(&worker, 1);
  Await([&] { return worker.acknowledged().size() == 1; });
  EXPECT_EQ(ReserveBytes(), options_.storage.reserve_bytes);
  files_.Fail(ENOSPC, "/film/");
  Deliver(&worker, 1);
  AwaitOutage();
  Await([&] { return ReserveBytes() == 0; });
  files_.Fail(ENOSPC);  // the reserve cannot be taken, but the ledger can be written
  const absl::Status cancelled = Cancel(other);
  EXPECT_TRUE(cancelled.ok()) << cancelled;
  EXPECT_EQ(worker.acknowledged().size(), 1u);
  files_.Heal();
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(ReserveBytes(), options_.storage.reserve_bytes);
}

TEST_F(StorageOutageTest, ALogThatAloneCannotBeWrittenIsSetAsideAndItsUnitsAreRenderedAgain) {
  constexpr int kUnits = 60;  // some are left when the log breaks
  const std::string expected = UndisturbedResult(kUnits);
  const job::JobId job = Submit(Spec(kUnits));
  const job::JobId other = Submit(Spec(kUnits), "other");
  auto worker = std::make_unique<PumpedWorker>(coordinator_.get(), 2);
  const std::string log = data_.PathOf(data_.UnitLogName(job, 0));
  Deliver(worker.get(), 4);
  Await([&] {
    return std::filesystem::exists(log) && coordinator_->jobs().GetJob(job.value())->units_done() > 0;
  });
  files_.Break(log);
  EXPECT_EQ(Finish(job, worker.get()).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Finish(other, worker.get()).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Result(job), expected);
  EXPECT_EQ(Result(other), expected);
  worker.reset();
  Stop();
  EXPECT_EQ(CountInLog("event=units_lost"), 1);
}

TEST_F(StorageOutageTest, ErrorsOfALogCountFromItsLastSuccess) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(3));
  PumpedWorker worker(coordinator_.get(), 1);
  Deliver(&worker, 1);
  for (size_t unit = 1; unit <= 4; ++unit) {
    Await([&] { return worker.acknowledged().size() == unit; });
    files_.FailWrites(2, ".units");  // a third one in a row would give the log up
    Deliver(&worker, 1);
  }
  Await([&] { return worker.acknowledged().size() == 5; });
  EXPECT_EQ(files_.failing_writes(), 0);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  coordinator_->Shutdown();
  EXPECT_EQ(CountInLog("event=units_lost"), 0);
}

TEST_F(StorageOutageTest, ACoordinatorThatStopsWithoutRoomLosesNothingAcknowledged) {
  const std::string expected = UndisturbedResult(3);
  const job::JobId job = Submit(Spec(3));
  std::set<job::UnitRef> acknowledged;
  {
    PumpedWorker worker(coordinator_.get(), 2);
    Deliver(&worker, 2);
    Await([&] { return worker.acknowledged().size() == 2; });
    files_.Fail(ENOSPC);
    Deliver(&worker, 2);
    AwaitOutage();
    acknowledged = worker.acknowledged();
    coordinator_->Shutdown();
  }
  Stop();
  files_.Heal();
  ASSERT_TRUE(Start().ok());
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  for (const job::UnitRef& unit : acknowledged)
    EXPECT_FALSE(worker.leased().contains(unit)) << Describe(unit);
  EXPECT_EQ(Result(job), expected);
}

TEST_F(StorageOutageTest, ABlockThatIsNotRecordedIsNotInForce) {
  ASSERT_TRUE(Start().ok());
  const PumpedWorker worker(coordinator_.get(), 1, "ann");
  OperatorApi& operators = coordinator_->operators();
  v1::WorkerRequest ann;
  ann.set_worker("ann");
  const auto state = [&] { return operators.ListWorkers({})->workers(0).state(); };
  fault_.Set("BlockWorker");
  EXPECT_TRUE(absl::IsUnavailable(operators.BlockWorker(ann).status()));
  EXPECT_EQ(state(), v1::WORKER_STATE_IDLE);
  fault_.Set("ReadmitWorker");
  ASSERT_TRUE(operators.BlockWorker(ann).ok());
  EXPECT_TRUE(absl::IsUnavailable(operators.ReadmitWorker(ann).status()));
  EXPECT_EQ(state(), v1::WORKER_STATE_BLOCKED) << "as it would be after a restart";
  fault_.Set("");
  ASSERT_TRUE(operators.ReadmitWorker(ann).ok());
  EXPECT_EQ(state(), v1::WORKER_STATE_IDLE);
}

}  // namespace
}  // namespace lumifold::server
