// Whose fault it is: no bad machine fails a job that another one can render, and no bad job costs the farm much.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::WorkerId;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const UnitFailure kImpossible{.permanent = true, .error = "no such texture"};

class DisputesTest : public SchedulerFixture {
 protected:
  void Add(int64_t id, const std::string& party, int slots = 1) {
    scheduler_.workers().Add(WorkerId(id), {.name = absl::StrCat(party, ":", id),
                                            .party = party,
                                            .numeric_class = "avx2",
                                            .instance = static_cast<uint64_t>(id),
                                            .slots = slots});
  }
  /// Gives the worker a unit, which it must get, and lets it fail.
  void Fail(int64_t id) {
    const std::vector<GrantedLease> leases = scheduler_.GrantLeases(WorkerId(id), now_);
    ASSERT_FALSE(leases.empty()) << "worker " << id;
    for (const GrantedLease& lease : leases)
      scheduler_.units().Fail(WorkerId(id), lease.unit, lease.attempt, kImpossible, now_);
  }
  /// The worker delivers a unit of another job.
  void MakeWitness(int64_t id) {
    const JobId job(absl::StrCat("of-", id));
    for (const JobId& other : {kJob, kOther}) scheduler_.jobs().Pause(other);
    scheduler_.jobs().Add(job, Spec());
    const std::vector<GrantedLease> leases = scheduler_.GrantLeases(WorkerId(id), now_);
    ASSERT_THAT(leases, SizeIs(1));
    ASSERT_EQ(leases[0].unit.job, job);
    scheduler_.units().Complete(WorkerId(id), leases[0].unit, leases[0].attempt, now_);
    scheduler_.units().Commit(leases[0].unit);
    scheduler_.jobs().End(job);
    for (const JobId& other : {kJob, kOther}) scheduler_.jobs().Resume(other);
  }
  std::vector<FailedJob> Wait(absl::Duration time) {
    now_ += time;
    scheduler_.ExpireLeases(now_);
    return scheduler_.TakeFailedJobs();
  }

  absl::Time now_ = kStart;
};

TEST_F(DisputesTest, TheWordOfOneThatHasDeliveredNothingFailsNoJob) {
  scheduler_.jobs().Add(kJob, Spec());
  Add(1, "new");
  Fail(1);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty()) << "it is not asked again";
  EXPECT_THAT(
      scheduler_.Explain(kJob, now_),
      Contains(AllOf(Field(&Reason::code, "second_opinion"),
                     Field(&Reason::text, AllOf(HasSubstr("worker new cannot render j-1 frame 10 tile"),
                                                HasSubstr("(no such texture); the job waits"))))));
  EXPECT_THAT(Wait(absl::Hours(1)), IsEmpty());
  Add(2, "good");
  EXPECT_THAT(scheduler_.GrantLeases(WorkerId(2), now_), SizeIs(1));
}

TEST_F(DisputesTest, ALoneWitnessIsBelievedAfterAMinute) {
  scheduler_.jobs().Add(kJob, Spec());
  Add(1, "lone");
  MakeWitness(1);
  Fail(1);
  EXPECT_THAT(Wait(absl::Seconds(59)), IsEmpty());
  EXPECT_THAT(
      scheduler_.Explain(kJob, now_),
      Contains(Field(&Reason::text, HasSubstr("the job fails in 1 s unless another worker connects"))));
  const std::vector<FailedJob> failed = Wait(absl::Seconds(1));
  ASSERT_THAT(failed, SizeIs(1));
  EXPECT_EQ(failed[0].job, kJob);
  EXPECT_EQ(failed[0].error, "no such texture");
}

TEST_F(DisputesTest, ALoneWitnessWaitsForWhoCouldBeAsked) {
  scheduler_.jobs().Add(kJob, Spec());
  Add(1, "witness");
  MakeWitness(1);
  Fail(1);
  Add(2, "other");
  EXPECT_THAT(Wait(absl::Minutes(3)), IsEmpty()) << "it may be busy";
  scheduler_.workers().Drain(WorkerId(2));
  EXPECT_THAT(Wait(absl::Minutes(1)), SizeIs(1));
}

TEST_F(DisputesTest, TwoWitnessesOrThreePartiesDecideAtOnce) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t id : {1, 2, 3}) Add(id, absl::StrCat("host", id));
  Fail(1);
  Fail(2);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
  Fail(3);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), SizeIs(1));
  scheduler_.jobs().End(kJob);
  scheduler_.jobs().Add(kOther, Spec());
  MakeWitness(1);
  MakeWitness(2);
  Fail(1);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty());
  Fail(2);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), SizeIs(1));
}

TEST_F(DisputesTest, WorkersOfOneMachineAreOneParty) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t id = 1; id <= 5; ++id) Add(id, "host", id == 1 ? 1 : 4);
  Fail(1);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty());
  EXPECT_THAT(Wait(absl::Hours(1)), IsEmpty());
}

TEST_F(DisputesTest, ADeliveryMakesAWitnessOfWhatWasSaidBefore) {
  scheduler_.jobs().Add(kJob, Spec());
  Add(1, "lone");
  Fail(1);
  EXPECT_THAT(Wait(absl::Minutes(2)), IsEmpty());
  MakeWitness(1);
  EXPECT_THAT(Wait(absl::Minutes(1)), SizeIs(1));
}

TEST_F(DisputesTest, ABadJobCostsAFewUnits) {
  for (const bool fresh : {true, false}) {
    const JobId job(fresh ? "fresh" : "proved");
    for (int64_t id = 1; id <= 50; ++id) {
      const int64_t worker = id + (fresh ? 0 : 100);
      Add(worker, absl::StrCat("host", worker));
      if (!fresh) MakeWitness(worker);
    }
    v1::JobSpec unplanned = Spec();
    unplanned.clear_planning();
    scheduler_.jobs().Add(job, unplanned);
    int failures = 0;
    while (scheduler_.jobs().Has(job)) {
      const std::vector<GrantedLease> leases = scheduler_.GrantLeases(now_);
      ASSERT_FALSE(leases.empty());
      failures += static_cast<int>(leases.size());
      for (const GrantedLease& lease : leases)
        scheduler_.units().Fail(lease.worker, lease.unit, lease.attempt, kImpossible, now_);
      for (const FailedJob& failed : Wait(absl::Seconds(1))) scheduler_.jobs().End(failed.job);
    }
    EXPECT_LE(failures, 3);
    for (int64_t id = 1; id <= 50; ++id) scheduler_.workers().Remove(WorkerId(id));
  }
}

// One machine that does to each unit what `spoil` says, restarts when it dies, and has the farm for itself for five
// minutes; then a good one comes.
class BadMachine {
 public:
  enum class Kind { kFails, kFailsNotForGood, kDies, kDrops, kHangs, kFailsOneJob };

  BadMachine(Scheduler* scheduler, Kind kind, absl::Time* now)
      : scheduler_(scheduler), kind_(kind), now_(now) {
    Connect();
  }

  void Take(const GrantedLease& lease) { held_.push_back(lease); }
  void Step() {
    std::vector<HeldLease> held;
    for (const GrantedLease& lease : held_)
      held.push_back({.unit = lease.unit, .attempt = lease.attempt, .progress = 0});
    scheduler_->workers().Heartbeat(id_, held, job::Attempt(0), *now_);
    if (held_.empty() || kind_ == Kind::kHangs) return;
    const std::vector<GrantedLease> leases = std::exchange(held_, {});
    if (kind_ == Kind::kDies) {
      scheduler_->workers().Remove(id_);
      return Connect();
    }
    if (kind_ == Kind::kDrops) {
      scheduler_->workers().Heartbeat(id_, {}, leases.back().attempt, *now_);
      return;
    }
    for (const GrantedLease& lease : leases) {
      if (kind_ == Kind::kFailsOneJob && lease.unit.job != kJob) {
        scheduler_->units().Complete(id_, lease.unit, lease.attempt, *now_);
        scheduler_->units().Commit(lease.unit);
      } else {
        scheduler_->units().Fail(id_, lease.unit, lease.attempt,
                                 {.permanent = kind_ != Kind::kFailsNotForGood, .error = "made up"}, *now_);
      }
    }
  }

 private:
  void Connect() {
    id_ = WorkerId(++last_);
    scheduler_->workers().Add(id_, {.name = absl::StrCat("bad:", last_),
                                    .party = "bad",
                                    .numeric_class = "avx2",
                                    .instance = static_cast<uint64_t>(last_),
                                    .slots = 2});
  }

  Scheduler* const scheduler_;
  const Kind kind_;
  absl::Time* const now_;
  int64_t last_ = 100;
  WorkerId id_;
  std::vector<GrantedLease> held_;
};

class BadMachineTest : public SchedulerFixture, public ::testing::WithParamInterface<BadMachine::Kind> {};

TEST_P(BadMachineTest, FailsNoJobThatAnotherMachineCanRender) {
  std::vector<JobId> jobs;
  for (int i = 0; i < 20; ++i) {
    jobs.push_back(i == 0 ? kJob : JobId(absl::StrCat("job-", i)));
    scheduler_.jobs().Add(jobs.back(), Spec());
  }
  absl::Time now = kStart;
  BadMachine bad(&scheduler_, GetParam(), &now);
  const bool is_witness = GetParam() == BadMachine::Kind::kFailsOneJob;
  const absl::Duration alone = is_witness ? absl::Seconds(50) : absl::Minutes(5);
  for (; now < kStart + absl::Hours(2); now += absl::Seconds(1)) {
    if (now == kStart + alone)
      scheduler_.workers().Add(kBen, {.name = "good", .numeric_class = "avx2", .slots = 2});
    scheduler_.ExpireLeases(now);
    for (const GrantedLease& lease : scheduler_.GrantLeases(now)) {
      if (lease.worker != kBen) {
        bad.Take(lease);
        continue;
      }
      Receive({lease});
      Commit(kBen, lease);
    }
    bad.Step();
    ASSERT_THAT(scheduler_.TakeFailedJobs(), IsEmpty()) << "after " << now - kStart;
    std::erase_if(jobs, [&](const JobId& job) {
      const JobProgress progress = scheduler_.jobs().Progress(job);
      return progress.units_done == progress.units_total;
    });
    if (jobs.empty()) break;
  }
  EXPECT_THAT(jobs, IsEmpty()) << "they are done after " << now - kStart;
}

INSTANTIATE_TEST_SUITE_P(Kinds, BadMachineTest,
                         ::testing::Values(BadMachine::Kind::kFails, BadMachine::Kind::kFailsNotForGood,
                                           BadMachine::Kind::kDies, BadMachine::Kind::kDrops,
                                           BadMachine::Kind::kHangs, BadMachine::Kind::kFailsOneJob));

}  // namespace
}  // namespace lumifold::scheduler
