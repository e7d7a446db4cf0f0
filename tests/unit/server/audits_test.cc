// Workers that deliver wrong pixels: a share of the units is rendered twice, and what they delivered is
// rendered again.
#include <gmock/gmock.h>

#include "server/job/job_state.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;

/// So many that a job without an audited unit is as good as impossible: which ones are audited depends on the
/// job's id.
constexpr int kTiles = 16;
constexpr size_t kUnits = 2 * kTiles;
constexpr uint32_t kWrong = 2;

class AuditsTest : public CoordinatorFixture {
 protected:
  std::string UndisturbedResult() {
    EXPECT_TRUE(Start().ok());
    const job::JobId job = Submit(Spec(kTiles), "undisturbed");
    PumpedWorker worker(coordinator_.get(), 3);
    EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
    return Result(job);
  }

  job::JobId SubmitAudited(double share) {
    scheduling_.set_audit_share(share);
    return Submit(Spec(kTiles));
  }

  /// Lets a faulty worker render all units of the job, until all are committed.
  std::unique_ptr<PumpedWorker> RenderWrong() {
    auto faulty =
        std::make_unique<PumpedWorker>(coordinator_.get(), static_cast<int>(kUnits), "faulty", kWrong);
    Await([&] {
      faulty->Deliver();
      return faulty->acknowledged().size() == kUnits;
    });
    return faulty;
  }

  v1::JobStatus FinishBy(const job::JobId& job, std::vector<PumpedWorker*> workers) {
    Await([&] {
      for (PumpedWorker* worker : workers) worker->Deliver();
      return job::HasEnded(coordinator_->jobs().GetJob(job.value())->state());
    });
    return *coordinator_->jobs().GetJob(job.value());
  }

  std::vector<std::string> Blocked() {
    const absl::StatusOr<std::vector<ledger::BlockedWorker>> blocked = store_->BlockedWorkers();
    EXPECT_TRUE(blocked.ok()) << blocked.status();
    std::vector<std::string> names;
    for (const ledger::BlockedWorker& worker : *blocked) names.push_back(worker.name);
    return names;
  }
};

TEST_F(AuditsTest, TheFaultyWorkerIsBlockedAndAllItsUnitsAreRenderedAgain) {
  const std::string expected = UndisturbedResult();
  const job::JobId job = SubmitAudited(0.5);
  const auto faulty = RenderWrong();
  const v1::ExplainJobResponse why = *coordinator_->jobs().ExplainJob(job.value());
  ASSERT_EQ(why.reasons_size(), 1);
  EXPECT_EQ(why.reasons(0).code(), "audit");
  PumpedWorker ann(coordinator_.get(), 2, "ann");
  PumpedWorker ben(coordinator_.get(), 2, "ben");
  const v1::JobStatus status = FinishBy(job, {&ann, &ben, faulty.get()});
  EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
  EXPECT_EQ(status.units_done(), static_cast<int64_t>(kUnits));
  EXPECT_EQ(Result(job), expected);
  Await([&] { return !Blocked().empty(); });
  EXPECT_THAT(Blocked(), ElementsAre("faulty"));
  const job::JobId next = Submit(Spec(kTiles), "next");
  EXPECT_EQ(faulty->leases(), 0);
  EXPECT_EQ(FinishBy(next, {&ann, &ben, faulty.get()}).state(), v1::JOB_STATE_DONE);
}

TEST_F(AuditsTest, AuditsBeginAgainAfterARestart) {
  const std::string expected = UndisturbedResult();
  const job::JobId job = SubmitAudited(0.5);
  RenderWrong();
  Stop();
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->units_done(), static_cast<int64_t>(kUnits));
  PumpedWorker ann(coordinator_.get(), 2, "ann");
  PumpedWorker ben(coordinator_.get(), 2, "ben");
  EXPECT_EQ(FinishBy(job, {&ann, &ben}).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Result(job), expected);
  Await([&] { return !Blocked().empty(); });
  EXPECT_THAT(Blocked(), ElementsAre("faulty"));
}

TEST_F(AuditsTest, ARestartDoesNotFindDiscardedUnitsInTheLog) {
  const std::string expected = UndisturbedResult();
  const job::JobId job = SubmitAudited(1);
  RenderWrong();
  {
    PumpedWorker ann(coordinator_.get(), static_cast<int>(kUnits), "ann");
    PumpedWorker ben(coordinator_.get(), static_cast<int>(kUnits), "ben");
    Await([&] {  // the units are discarded, and none is delivered again
      if (coordinator_->jobs().GetJob(job.value())->units_done() == 0) return true;
      ann.Deliver(1);
      ben.Deliver(1);
      return false;
    });
  }
  Stop();
  ASSERT_TRUE(Start().ok());
  EXPECT_LT(coordinator_->jobs().GetJob(job.value())->units_done(), static_cast<int64_t>(kUnits));
  scheduling_.clear_audit_share();
  PumpedWorker ann(coordinator_.get(), 2, "ann");
  PumpedWorker ben(coordinator_.get(), 2, "ben");
  EXPECT_EQ(FinishBy(job, {&ann, &ben}).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Result(job), expected);
}

access::Identity Certificate(const std::string& name) {
  return {.kind = access::IdentityKind::kWorker, .name = name, .scopes = {}, .id = "serial of " + name};
}

TEST_F(AuditsTest, ProcessesWithOneCertificateAreOneParty) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = SubmitAudited(1);
  PumpedWorker first(coordinator_.get(), static_cast<int>(kUnits), "host:1", 1, Certificate("node-1"));
  PumpedWorker second(coordinator_.get(), static_cast<int>(kUnits), "host:2", 1, Certificate("node-1"));
  Await([&] {
    first.Deliver();
    second.Deliver();
    return first.acknowledged().size() + second.acknowledged().size() == kUnits;
  });
  EXPECT_EQ(first.leases() + second.leases(), 0) << "it would audit itself";
  EXPECT_EQ(coordinator_->jobs().ExplainJob(job.value())->reasons(0).code(), "audit");
  PumpedWorker other(coordinator_.get(), 1, "host:1", 1, Certificate("node-2"));
  EXPECT_EQ(FinishBy(job, {&other}).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(other.leased().size(), kUnits);
}

TEST_F(AuditsTest, ABlockHoldsForAllProcessesWithTheCertificate) {
  ASSERT_TRUE(Start().ok());
  v1::WorkerRequest request;
  request.set_worker("node-1");
  ASSERT_TRUE(coordinator_->operators().BlockWorker(request).ok());
  PumpedWorker renamed(coordinator_.get(), 1, "another name", 1, Certificate("node-1"));
  const v1::ListWorkersResponse listed = *coordinator_->operators().ListWorkers({});
  ASSERT_EQ(listed.workers_size(), 1);
  EXPECT_EQ(listed.workers(0).name(), "node-1");
  EXPECT_EQ(listed.workers(0).process(), "another\\x20name");
  EXPECT_EQ(listed.workers(0).state(), v1::WORKER_STATE_BLOCKED);
  PumpedWorker named_alike(coordinator_.get(), 1, "node-1", 1, Certificate("node-2"));
  const job::JobId job = Submit(Spec(kTiles));
  EXPECT_EQ(FinishBy(job, {&renamed, &named_alike}).state(), v1::JOB_STATE_DONE);
  EXPECT_TRUE(renamed.leased().empty());
}

TEST_F(AuditsTest, AFrameIsFinishedOnceItsAuditsAreSettled) {
  const std::string expected = UndisturbedResult();
  const job::JobId job = SubmitAudited(1);
  PumpedWorker ann(coordinator_.get(), static_cast<int>(kUnits), "ann");
  Await([&] {
    ann.Deliver();
    return ann.acknowledged().size() == kUnits;
  });
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_RUNNING);
  PumpedWorker ben(coordinator_.get(), 1, "ben");
  EXPECT_EQ(FinishBy(job, {&ben}).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(ben.leased().size(), kUnits);
  EXPECT_EQ(Result(job), expected);
  EXPECT_THAT(Blocked(), ElementsAre());
}

}  // namespace
}  // namespace lumifold::server
