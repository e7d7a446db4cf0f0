// What a data folder has beyond its ledger: tails of unit logs, and manifests from which a lost ledger is
// rebuilt.
#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/commit/recover.h"
#include "server/film/unit_record.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class RecoveryTest : public CoordinatorFixture {
 protected:
  RecoveryTest() {
    wrap_store_ = [this](std::unique_ptr<ledger::JobStore> store) {
      return std::make_unique<FailingStore>(std::move(store), &fault_);
    };
    EXPECT_TRUE(Start().ok());
    const job::JobId job = Submit(Spec(3), "undisturbed");
    PumpedWorker worker(coordinator_.get(), 3);
    EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
    expected_ = Result(job);
    done_ = job;
  }

  /// Commits some units of the active job and stops; returns them.
  std::set<job::UnitRef> RenderSome(int count) {
    PumpedWorker worker(coordinator_.get(), 1);
    int delivered = 0;
    while (static_cast<int>(worker.acknowledged().size()) < count) {
      if (delivered < count) delivered += worker.Deliver(1);
      absl::SleepFor(absl::Milliseconds(1));
    }
    std::set<job::UnitRef> acknowledged = worker.acknowledged();
    coordinator_->Shutdown();
    return acknowledged;
  }

  void FinishWithout(const std::set<job::UnitRef>& committed, const job::JobId& job) {
    PumpedWorker worker(coordinator_.get(), 2);
    const v1::JobStatus status = Finish(job, &worker);
    EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
    EXPECT_EQ(status.units_done(), 6);
    for (const job::UnitRef& unit : committed) EXPECT_FALSE(worker.leased().contains(unit)) << Describe(unit);
    EXPECT_EQ(worker.leased().size() + committed.size(), 6u);
    EXPECT_EQ(Result(job), expected_);
  }

  void DeleteLedger() {
    for (const char* suffix : {"", "-wal", "-shm"}) fs::remove(data_.LedgerPath() + suffix);
  }

  std::string LogOf(const job::JobId& job) const { return data_.PathOf(data_.UnitLogName(job, 0)); }

  FailingStore::Fault fault_;
  std::string expected_;
  job::JobId done_;
};

TEST_F(RecoveryTest, ARecordOfAnotherVersionFailsItsJobAndTheOthersGoOn) {
  const job::JobId mixed = Submit(Spec(3), "mixed");
  RenderSome(2);
  Stop();
  film::RecordPreamble preamble;
  ++preamble.magic.back();
  std::ofstream(LogOf(mixed), std::ios::binary | std::ios::app)
      .write(reinterpret_cast<const char*>(&preamble), sizeof preamble);
  ASSERT_TRUE(Start().ok());
  const auto status = [&] { return *coordinator_->jobs().GetJob(mixed.value()); };
  Await([&] { return status().state() == v1::JOB_STATE_FAILED; });
  EXPECT_THAT(status().error(), HasSubstr("another version of Lumifold"));
  const job::JobId other = Submit(Spec(3), "other");
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(other, &worker).state(), v1::JOB_STATE_DONE);
}

TEST_F(RecoveryTest, RecordsThatTheLedgerDoesNotKnowAreCommittedAtTheStart) {
  const job::JobId job = Submit(Spec(3));
  std::set<job::UnitRef> written;
  {
    PumpedWorker worker(coordinator_.get(), 4);
    fault_.Set("CommitUnits");
    worker.Deliver(4);
    // The first batch may have some of them only; the others follow when it is repeated with all.
    Await([this] { return fault_.count() > 0; });
    coordinator_->Shutdown();
    written = worker.leased();
    EXPECT_TRUE(worker.acknowledged().empty());
  }
  Stop();
  fault_.Set("");
  const uint64_t size = fs::file_size(LogOf(job));
  ASSERT_GT(size, 0u);
  // A torn tail behind the records.
  std::ofstream(LogOf(job), std::ios::app) << "LFU8 and then nothing";
  ASSERT_TRUE(Start().ok());
  const int64_t restored = coordinator_->jobs().GetJob(job.value())->units_done();
  EXPECT_GT(restored, 0);
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker.leased().size(), static_cast<size_t>(6 - restored));
  EXPECT_EQ(Result(job), expected_);
}

TEST_F(RecoveryTest, AFolderWithJobsButWithoutALedgerIsRefusedAndRecovered) {
  const job::JobId job = Submit(Spec(3));
  const std::set<job::UnitRef> committed = RenderSome(4);
  Stop();
  DeleteLedger();
  const absl::Status refused = Start();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(refused.message()),
              HasSubstr(absl::StrCat("lumifold-server recover --data ", data_.root())));
  Stop();
  // Twice: the second time the ledger of the first is replaced by an equal one.
  for (int i = 0; i < 2; ++i) {
    const absl::StatusOr<std::string> report = RecoverLedger(data_);
    ASSERT_TRUE(report.ok()) << report.status();
    EXPECT_THAT(*report, HasSubstr("jobs: 1 active, 1 ended\nunits read from logs: 4\nresults: 1\n"));
  }
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(coordinator_->jobs().GetJob(done_.value())->state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*TrySubmit(Spec(3), "undisturbed"), done_) << "its request id is known";
  FinishWithout(committed, job);
}

TEST_F(RecoveryTest, ARecoveredJobIsScheduledAsItWasLast) {
  const job::JobId job = Submit(Spec(3));
  v1::SetJobPriorityRequest request;
  request.set_job_id(job.value());
  request.set_priority(7);
  ASSERT_TRUE(coordinator_->operators().SetJobPriority(request).ok());
  ASSERT_TRUE(coordinator_->operators().PauseJob(job.value()).ok());
  coordinator_->Shutdown();
  Stop();
  DeleteLedger();
  ASSERT_TRUE(RecoverLedger(data_).ok());
  ASSERT_TRUE(Start().ok());
  const v1::JobStatus status = *coordinator_->jobs().GetJob(job.value());
  EXPECT_EQ(status.state(), v1::JOB_STATE_PAUSED);
  EXPECT_EQ(status.scheduling().priority(), 7);
}

TEST_F(RecoveryTest, ADamagedRecordIsLeftOutAndRenderedAgain) {
  const job::JobId job = Submit(Spec(3));
  const std::set<job::UnitRef> committed = RenderSome(4);
  Stop();
  DeleteLedger();
  {
    std::fstream log(LogOf(job), std::ios::in | std::ios::out | std::ios::binary);
    log.seekp(200).put('!');
  }
  EXPECT_THAT(*RecoverLedger(data_), HasSubstr("units read from logs: 3\n"));
  ASSERT_TRUE(Start().ok());
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker.leased().size(), 3u);
  EXPECT_EQ(Result(job), expected_);
}

TEST_F(RecoveryTest, AMalformedLedgerIsRefusedWithTheCommandAndKept) {
  const job::JobId job = Submit(Spec(3));
  const std::set<job::UnitRef> committed = RenderSome(3);
  Stop();
  {
    std::fstream ledger(data_.LedgerPath(), std::ios::in | std::ios::out | std::ios::binary);
    ledger.seekp(0) << std::string(200, 'x');
  }
  for (const char* suffix : {"-wal", "-shm"}) fs::remove(data_.LedgerPath() + suffix);
  const absl::Status refused = Start();
  EXPECT_EQ(refused.code(), absl::StatusCode::kDataLoss) << refused;
  EXPECT_THAT(std::string(refused.message()), HasSubstr("lumifold-server recover --data "));
  Stop();
  EXPECT_THAT(*RecoverLedger(data_), HasSubstr("ledger.db.old-1"));
  EXPECT_TRUE(fs::exists(data_.LedgerPath() + ".old-1"));
  ASSERT_TRUE(Start().ok());
  FinishWithout(committed, job);
}

TEST_F(RecoveryTest, ACancelledJobStaysCancelledAndDamagedManifestsAreNamed) {
  const job::JobId cancelled = Submit(Spec(3), "cancelled");
  coordinator_->changes().CancelJob(cancelled.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
  PumpedWorker worker(coordinator_.get(), 1);
  EXPECT_EQ(Finish(cancelled, &worker).state(), v1::JOB_STATE_CANCELLED);
  Await([&] { return fs::exists(data_.EndedManifestPath(cancelled)); });
  const job::JobId damaged = Submit(Spec(3), "damaged");  // no worker takes its units any more
  coordinator_->Shutdown();
  {
    std::fstream manifest(data_.ManifestPath(damaged), std::ios::in | std::ios::out | std::ios::binary);
    manifest.seekp(30).put('!');
  }
  DeleteLedger();
  lock_ = rpc::FileHandle();
  const absl::StatusOr<std::string> report = RecoverLedger(data_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_THAT(*report, HasSubstr("jobs: 0 active, 2 ended"));
  EXPECT_THAT(*report, HasSubstr(absl::StrCat("left out: ", data_.ManifestPath(damaged),
                                              ": the manifest is damaged")));
}

TEST_F(RecoveryTest, AJobWhoseManifestAloneIsKnownIsStarted) {
  // The machine stopped between the manifest of a submission and its row.
  fault_.Set("CreateJob");
  EXPECT_FALSE(TrySubmit(Spec(3), "forgotten").ok());
  fault_.Set("");
  coordinator_->Shutdown();
  Stop();
  ASSERT_TRUE(Start().ok());
  const job::JobId job = *TrySubmit(Spec(3), "forgotten");
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(coordinator_->jobs().ListJobs({})->jobs_size(), 2);
}

/// Keeps what it is told.
class LastStatus final : public JobWatcher {
 public:
  void OnStatus(const v1::JobStatus& status) override {
    absl::MutexLock lock(&mutex_);
    status_ = status;
  }
  void OnLost(const absl::Status& cause) override {
    absl::MutexLock lock(&mutex_);
    lost_ = cause;
  }
  v1::JobState state() const {
    absl::MutexLock lock(&mutex_);
    return status_.state();
  }
  absl::Status lost() const {
    absl::MutexLock lock(&mutex_);
    return lost_;
  }

 private:
  mutable absl::Mutex mutex_;
  v1::JobStatus status_ ABSL_GUARDED_BY(mutex_);
  absl::Status lost_ ABSL_GUARDED_BY(mutex_);
};

TEST_F(RecoveryTest, AFolderThatASubmissionLeftWithoutAManifestIsRemoved) {
  Stop();
  const std::string begun = data_.FilmPath(job::JobId("j-begun"));
  const std::string written = data_.FilmPath(job::JobId("j-written"));
  const std::string film = data_.FilmPath(job::JobId("j-film"));
  for (const std::string& folder : {begun, written, film}) fs::create_directory(folder);
  std::ofstream(written + "/manifest.partial") << "half";
  std::ofstream(film + "/frame-0000.units") << "whose?";
  ASSERT_TRUE(Start().ok());
  EXPECT_FALSE(fs::exists(begun));
  EXPECT_FALSE(fs::exists(written));
  EXPECT_TRUE(fs::exists(film + "/frame-0000.units")) << "what has content is left alone";
}

TEST_F(RecoveryTest, AJobThatIsBeingTakenOverIsUnavailableToThoseWhoFollowOrChangeIt) {
  // Its row is this coordinator's already, but it is not in memory yet.
  const job::JobId job("j-taken-over");
  const ledger::JobRecord known = *store_->GetJob(done_);
  ASSERT_TRUE(store_
                  ->CreateJob({.id = job,
                               .request_id = "elsewhere",
                               .spec = known.spec,
                               .scheduling = known.scheduling,
                               .submitted = known.submitted,
                               .owner = coordinator_->resources().owner})
                  .ok());
  LastStatus watcher;
  EXPECT_TRUE(absl::IsUnavailable(coordinator_->jobs().Watch(job.value(), &watcher)));
  EXPECT_EQ(watcher.state(), coordinator_->jobs().GetJob(job.value())->state())
      << "who follows it gets to know it";
  EXPECT_TRUE(absl::IsUnavailable(coordinator_->operators().PauseJob(job.value()).status()));
  absl::Status cancelled;
  coordinator_->changes().CancelJob(
      job.value(), [&](const absl::StatusOr<v1::JobStatus>& status) { cancelled = status.status(); });
  EXPECT_TRUE(absl::IsUnavailable(cancelled));
  coordinator_->member().Adopt({{.id = job, .has_ended = false}});
  Await([&] { return coordinator_->jobs().Watch(job.value(), &watcher).ok(); });
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  Await([&] { return watcher.state() == v1::JOB_STATE_DONE; });
  coordinator_->jobs().Unwatch(&watcher);
}

TEST_F(RecoveryTest, TheMachineThatRenderedPartOfAJobIsBelievedAfterARestart) {
  options_.insecure = true;  // workers have no certificates: HOST:PROCESS
  const job::JobId job = Submit(Spec(3), "begun");
  {
    PumpedWorker worker(coordinator_.get(), 1, "host:17");
    Deliver(&worker, 1);
    Await([&] { return worker.acknowledged().size() == 1; });
  }
  const auto reason = [&](const std::string& worker) {
    PumpedWorker failing(coordinator_.get(), 1, worker);
    Await([&] { return failing.leases() > 0; });
    failing.Fail();
    const v1::ExplainJobResponse why = *coordinator_->jobs().ExplainJob(job.value());
    for (const v1::Reason& found : why.reasons()) {
      if (found.code() == "second_opinion") return found.text();
    }
    return std::string();
  };
  for (const auto& [worker, expected] : {std::pair{"host:18", "the job fails in "},
                                         std::pair{"stranger:1", "the job waits for another worker"}}) {
    Stop();
    ASSERT_TRUE(Start().ok());
    EXPECT_THAT(reason(worker), HasSubstr(expected)) << worker;
  }
}

TEST_F(RecoveryTest, WhoFollowsOrCancelsAJobThatWasLostIsToldToAskAgain) {
  const job::JobId job = Submit(Spec(3), "lost");
  LastStatus watcher;
  ASSERT_TRUE(coordinator_->jobs().Watch(job.value(), &watcher).ok());
  const v1::JobState known = watcher.state();
  const ledger::Epoch later = *store_->NewEpoch({});
  ASSERT_TRUE(store_->ClaimUnfinishedJobs({.name = "another", .epoch = later}).ok());
  const absl::Status answer = Cancel(job);
  EXPECT_TRUE(absl::IsUnavailable(answer)) << answer;
  EXPECT_EQ(watcher.lost(), answer);
  EXPECT_EQ(watcher.state(), known) << "nobody hears of an end that the job does not have";
  coordinator_->jobs().Unwatch(&watcher);
}

}  // namespace
}  // namespace lumifold::server
