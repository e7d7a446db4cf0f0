// The coordinator commits the plan of a job before it divides it. Faults at every write:
// fault_enumeration_test.cc.
#include <gmock/gmock.h>

#include "server/commit/recover.h"
#include "server/storage/manifest.h"
#include "tests/support/made_up_plan.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

class PlanUnitTest : public CoordinatorFixture {
 protected:
  PlanUnitTest() {
    wrap_store_ = [this](std::unique_ptr<ledger::JobStore> store) {
      return std::make_unique<FailingStore>(std::move(store), &fault_);
    };
  }

  v1::Plan PlanOf(const job::JobId& job) { return coordinator_->jobs().ExplainJob(job.value())->plan(); }
  bool IsPlanned(const job::JobId& job) { return PlanOf(job).decisions_size() > 0; }
  static job::UnitRef PlanUnit(const job::JobId& job) { return {job, {0, 0, 0, v1::UNIT_KIND_PLAN}}; }

  FailingStore::Fault fault_;
};

TEST_F(PlanUnitTest, TheJobIsDividedByItsPlan) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec(4));
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_SUBMITTED);
  PumpedWorker worker(coordinator_.get(), 3);
  EXPECT_FALSE(IsPlanned(job));
  EXPECT_EQ(worker.leases(), 1);
  worker.DeliverPlan(MadeUpPlan(16, 2));
  Await([&] { return IsPlanned(job); });
  EXPECT_THAT(PlanOf(job).numeric_class(), testing::StartsWith("test"));
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->units_total(), 2 * (1 + 2));
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(PlanOf(job).decisions_size(), MadeUpPlan().decisions_size()) << "also of a job that has ended";
  EXPECT_THAT(Result(job), HasSubstr("tile-size=16:probe"));
}

TEST_F(PlanUnitTest, APlanInASubmissionIsRefused) {
  ASSERT_TRUE(Start().ok());
  v1::JobSpec spec = UnplannedSpec();
  *spec.mutable_plan() = MadeUpPlan();
  EXPECT_EQ(TrySubmit(spec).status().code(), absl::StatusCode::kInvalidArgument);
  v1::JobSpec forcing = UnplannedSpec();
  forcing.mutable_planning()->add_forced("speed=9");
  EXPECT_THAT(std::string(TrySubmit(forcing).status().message()), HasSubstr("planning.forced: 'speed=9'"));
}

TEST_F(PlanUnitTest, AFullJobHasNoPlanUnit) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec());
  PumpedWorker worker(coordinator_.get(), 3);
  EXPECT_THAT(worker.leased(), Not(Contains(PlanUnit(job))));
  EXPECT_EQ(PlanOf(job).decisions(0).source(), v1::DECISION_SOURCE_FULL);
}

TEST_F(PlanUnitTest, APlanThatIsNotValidFailsItsUnit) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec());
  PumpedWorker worker(coordinator_.get(), 1);
  v1::Plan plan = MadeUpPlan();
  plan.mutable_decisions(1)->set_value(4);
  worker.DeliverPlan(plan);
  EXPECT_FALSE(IsPlanned(job));
  Await([&] { return worker.leases() == 1; });  // after its backoff
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(worker.acknowledged(), Contains(PlanUnit(job)));
}

TEST_F(PlanUnitTest, PixelsOfAPlanUnitAndPlansOfOthersAreRefused) {
  ASSERT_TRUE(Start().ok());
  v1::JobSpec spec = Spec();
  const job::JobId full = Submit(spec);
  PumpedWorker worker(coordinator_.get(), 1);
  worker.DeliverPlan(MadeUpPlan());  // of its geometry unit
  Await([&] { return worker.leases() == 1; });
  EXPECT_EQ(Finish(full, &worker).state(), v1::JOB_STATE_DONE);
  const job::JobId job = Submit(UnplannedSpec(), "request-2");
  Await([&] { return worker.leases() == 1; });
  worker.DeliverPixels();
  EXPECT_FALSE(IsPlanned(job));
  Await([&] { return worker.leases() == 1; });
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

TEST_F(PlanUnitTest, WithoutStorageThePlanWaits) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec());
  PumpedWorker worker(coordinator_.get(), 2);
  fault_.Set("SetPlan");
  worker.DeliverPlan(MadeUpPlan());
  Await([&] { return fault_.count() > 2; });
  EXPECT_FALSE(IsPlanned(job));
  EXPECT_EQ(worker.leases(), 0) << "the job is not divided before its plan is committed";
  fault_.Set("");
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

/// Calls `before` when a plan is about to be recorded.
class PlanWatchingStore final : public StoreWrapper {
 public:
  PlanWatchingStore(std::unique_ptr<ledger::JobStore> store, std::function<void()> before)
      : StoreWrapper(std::move(store)), before_(std::move(before)) {}

 private:
  absl::Status Before(const std::string& call) override {
    if (call == "SetPlan") before_();
    return absl::OkStatus();
  }

  const std::function<void()> before_;
};

TEST_F(PlanUnitTest, AJobMayEndWhileItsPlanIsRecorded) {
  job::JobId job;
  wrap_store_ = [&](std::unique_ptr<ledger::JobStore> store) {
    return std::make_unique<PlanWatchingStore>(std::move(store), [&] {
      coordinator_->changes().CancelJob(job.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
    });
  };
  ASSERT_TRUE(Start().ok());
  job = Submit(UnplannedSpec());
  PumpedWorker worker(coordinator_.get(), 2);
  worker.DeliverPlan(MadeUpPlan());
  Await([&] { return coordinator_->jobs().GetJob(job.value())->state() == v1::JOB_STATE_CANCELLED; });
  EXPECT_EQ(worker.leases(), 0);
}

TEST_F(PlanUnitTest, ARestartBeforeThePlanIsCommittedPlansAgain) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec());
  {
    PumpedWorker worker(coordinator_.get(), 2);
    fault_.Set("SetPlan");
    worker.DeliverPlan(MadeUpPlan(16, 4));
    Await([&] { return fault_.count() > 0; });
    coordinator_->Shutdown();
  }
  Stop();
  fault_.Set("");
  ASSERT_TRUE(Start().ok());
  EXPECT_FALSE(IsPlanned(job));
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_THAT(worker.leased(), Contains(PlanUnit(job)));
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

TEST_F(PlanUnitTest, ARestartAfterThePlanIsCommittedKeepsIt) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec());
  {
    PumpedWorker worker(coordinator_.get(), 2);
    worker.DeliverPlan(MadeUpPlan(16, 2));
    Await([&] { return IsPlanned(job); });
    coordinator_->Shutdown();
  }
  Stop();
  ASSERT_TRUE(Start().ok());
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->state(), v1::JOB_STATE_PLANNED);
  PumpedWorker worker(coordinator_.get(), 2);
  EXPECT_THAT(worker.leased(), Not(Contains(PlanUnit(job))));
  EXPECT_EQ(coordinator_->jobs().GetJob(job.value())->units_total(), 1 + 2);
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

TEST_F(PlanUnitTest, ThePlanIsInTheManifest) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec(2));
  {
    PumpedWorker worker(coordinator_.get(), 1);
    worker.DeliverPlan(MadeUpPlan(8, 2));
    Await([&] { return IsPlanned(job); });
    Deliver(&worker, 1);
    Await([&] { return worker.acknowledged().size() == 2; });
    coordinator_->Shutdown();
  }
  Stop();
  std::filesystem::remove(data_.LedgerPath());
  const absl::StatusOr<std::string> report = RecoverLedger(data_);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_THAT(*report, HasSubstr("units read from logs: 1"));
  ASSERT_TRUE(Start().ok());
  EXPECT_TRUE(IsPlanned(job));
  EXPECT_EQ(Submit(UnplannedSpec(2)), job) << "the request finds its job";
}

TEST_F(PlanUnitTest, AJobWithoutAPlanCanBeCancelledAndRetried) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(UnplannedSpec());
  PumpedWorker worker(coordinator_.get(), 1);
  coordinator_->changes().CancelJob(job.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
  Await([&] { return coordinator_->jobs().GetJob(job.value())->state() == v1::JOB_STATE_CANCELLED; });
  worker.DeliverPlan(MadeUpPlan());  // in vain
  v1::RetryJobRequest request;
  request.set_job_id(job.value());
  coordinator_->changes().RetryJob(request, [](const absl::StatusOr<v1::JobStatus>& status) {
    EXPECT_TRUE(status.ok()) << status.status();
  });
  Await([&] { return worker.leases() == 1; });
  EXPECT_FALSE(IsPlanned(job));
  EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
}

}  // namespace
}  // namespace lumifold::server
