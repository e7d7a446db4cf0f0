// Whose fault it is: no bad machine fails a job that another one can render, and no bad job costs the farm
// much.
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

TEST_F(DisputesTest, WhoCalledOneUnitImpossibleIsAskedAboutTheFirstOfOthers) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int64_t id : {1, 2, 3}) Add(id, absl::StrCat("host", id));
  const std::vector<GrantedLease> wave = scheduler_.GrantLeases(now_);
  ASSERT_THAT(wave, SizeIs(3));
  for (const GrantedLease& lease : wave)
    scheduler_.units().Fail(lease.worker, lease.unit, lease.attempt, kImpossible, now_);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), IsEmpty()) << "each of another unit";
  for (int64_t id : {2, 3}) Fail(id);
  EXPECT_THAT(scheduler_.TakeFailedJobs(), SizeIs(1));
}

TEST_F(DisputesTest, WhoDeliveredBeforeARestartIsAWitness) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().AddWitness("lone");
  Add(1, "lone");
  Fail(1);
  EXPECT_THAT(Wait(absl::Seconds(59)), IsEmpty());
  EXPECT_THAT(Wait(absl::Seconds(1)), SizeIs(1));
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

}  // namespace
}  // namespace lumifold::scheduler
