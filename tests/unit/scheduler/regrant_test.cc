// Units that workers have in hand from connections that broke.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::UnitRef;
using job::WorkerId;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr uint64_t kProcess = 77;

UnitRef Pass(int tile, int pass, const job::JobId& job = kJob, int32_t frame = 10) {
  return {job, {frame, tile, pass, v1::UNIT_KIND_PASS}};
}

class RegrantTest : public SchedulerFixture {
 protected:
  void AddWorker(WorkerId worker, int slots, uint64_t instance = 0, const std::string& name = "ann") {
    scheduler_.workers().Add(worker,
                             {.name = name, .numeric_class = "c", .instance = instance, .slots = slots});
  }
  std::vector<GrantedLease> Regrant(WorkerId worker, const std::vector<UnitRef>& units) {
    return scheduler_.Regrant(worker, units, kStart);
  }
  /// Lets the worker deliver all that is left; the number of its units.
  int Finish(WorkerId worker) {
    int count = 0;
    for (auto leases = scheduler_.GrantLeases(kStart); !leases.empty();
         leases = scheduler_.GrantLeases(kStart)) {
      for (const GrantedLease& lease : leases) {
        Commit(worker, lease);
        ++count;
      }
    }
    return count;
  }
};

TEST_F(RegrantTest, UnitsThatWereNeverLeasedHereAreLeasedOnce) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 4);
  const auto leases = Regrant(kAnn, {Pass(3, 1), Pass(1, 0)});
  ASSERT_THAT(leases, SizeIs(2));
  EXPECT_EQ(leases[0].unit, Pass(3, 1));
  EXPECT_EQ(leases[1].unit, Pass(1, 0));
  EXPECT_EQ(leases[0].samples.blocks()[0].first, 4u);
  EXPECT_THAT(Regrant(kAnn, {Pass(3, 1)}), IsEmpty()) << "it has the lease";
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  EXPECT_EQ(Finish(kAnn), 10) << "12 units, of which two are committed";
  EXPECT_TRUE(scheduler_.frames().IsCommitted(kJob, 10));
}

TEST_F(RegrantTest, TheOtherUnitsKeepTheirOrder) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 12);
  const std::vector<GrantedLease> all = scheduler_.GrantLeases(kStart);
  std::vector<UnitRef> order;
  for (const GrantedLease& lease : all) order.push_back(lease.unit);
  Scheduler other({.lease = absl::Seconds(30)});
  other.jobs().Add(kJob, Spec());
  other.workers().Add(kAnn, {.name = "ann", .numeric_class = "c", .slots = 12});
  const std::vector<UnitRef> in_hand = {order[5], order[6], order[11]};
  EXPECT_THAT(other.Regrant(kAnn, in_hand, kStart), SizeIs(3));
  std::vector<UnitRef> rest;
  for (const GrantedLease& lease : other.GrantLeases(kStart)) rest.push_back(lease.unit);
  std::vector<UnitRef> expected;
  for (const UnitRef& unit : order) {
    if (std::find(in_hand.begin(), in_hand.end(), unit) == in_hand.end()) expected.push_back(unit);
  }
  EXPECT_EQ(rest, expected);
}

TEST_F(RegrantTest, ALeaseThatIsHandedBackIsFreeLikeAnyOther) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 12);
  const auto leases = Regrant(kAnn, {Pass(3, 1)});
  EXPECT_TRUE(scheduler_.units().HandBack(kAnn, leases[0].unit, leases[0].attempt));
  EXPECT_EQ(Finish(kAnn), 12);
}

TEST_F(RegrantTest, AUnitThatIsRevokedIsLeasedAgain) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 12);
  Commit(kAnn, Regrant(kAnn, {Pass(3, 1)})[0]);
  EXPECT_TRUE(scheduler_.units().Revoke(Pass(3, 1)));
  EXPECT_EQ(Finish(kAnn), 12);
}

TEST_F(RegrantTest, HoldsNoMoreLeasesThanTheWorkerHasSlots) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 2);
  EXPECT_THAT(Regrant(kAnn, {Pass(0, 0), Pass(0, 1), Pass(1, 0)}), SizeIs(2));
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
}

TEST_F(RegrantTest, NothingOfWhatTheWorkerMayNotLease) {
  scheduler_.jobs().Add(kJob, Spec(), {.paused = true});
  scheduler_.jobs().Add(kOther, Spec(), {.tags = {"gpu"}});
  AddWorker(kAnn, 4);
  EXPECT_THAT(Regrant(kAnn, {Pass(0, 0), Pass(0, 0, kOther), Pass(0, 0, job::JobId("j-3"))}), IsEmpty());
  scheduler_.jobs().Resume(kJob);
  EXPECT_THAT(Regrant(kAnn, {Pass(99, 0), Pass(0, 9), Pass(0, 0, kJob, 11)}), IsEmpty()) << "no such units";
  scheduler_.workers().Block("ann", "");
  EXPECT_THAT(Regrant(kAnn, {Pass(0, 0)}), IsEmpty());
}

TEST_F(RegrantTest, OpensNoFrameBeyondTheLimit) {
  scheduler_.jobs().Add(kJob, Spec(2));
  scheduler_.frames().SetMaxActive(1);
  AddWorker(kAnn, 4);
  EXPECT_THAT(Regrant(kAnn, {Pass(0, 0), Pass(0, 0, kJob, 11)}), SizeIs(1));
}

TEST_F(RegrantTest, AUnitThatHasAResultIsNotWanted) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 1);
  EXPECT_FALSE(scheduler_.units().HasResult(Pass(0, 0)));
  const auto leases = Regrant(kAnn, {Pass(0, 0)});
  scheduler_.units().Complete(kAnn, leases[0].unit, leases[0].attempt, kStart);
  EXPECT_TRUE(scheduler_.units().HasResult(Pass(0, 0)));
  AddWorker(kBen, 1, 0, "ben");
  EXPECT_THAT(Regrant(kBen, {Pass(0, 0)}), IsEmpty());
}

TEST_F(RegrantTest, AUnitThatAnotherWorkerGotMeanwhileIsLeasedTwiceAndTheFirstResultCounts) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kBen, 1, 0, "ben");
  const auto first = scheduler_.GrantLeases(kStart);
  AddWorker(kAnn, 1);
  const auto second = Regrant(kAnn, {first[0].unit});
  ASSERT_THAT(second, SizeIs(1));
  AddWorker(WorkerId(3), 1, 0, "cid");
  EXPECT_THAT(Regrant(WorkerId(3), {first[0].unit}), IsEmpty()) << "a third lease";
  Commit(kAnn, second[0]);
  EXPECT_FALSE(scheduler_.units().HoldsLease(kBen, first[0].unit, first[0].attempt));
  ASSERT_THAT(scheduler_.units().TakeRevoked(), SizeIs(1));
}

TEST_F(RegrantTest, TheLeasesOfAnEarlierConnectionAreThoseOfTheNext) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 4, kProcess);
  const auto before = scheduler_.GrantLeases(kStart);
  AddWorker(kBen, 4, kProcess);  // the same process; the end of its first connection is not known yet
  const auto after = Regrant(kBen, {before[1].unit, before[2].unit});
  ASSERT_THAT(after, SizeIs(2));
  EXPECT_NE(after[0].attempt, before[1].attempt);
  for (const GrantedLease& lease : before)
    EXPECT_FALSE(scheduler_.units().HoldsLease(kAnn, lease.unit, lease.attempt));
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) EXPECT_EQ(lease.worker, kBen);
  EXPECT_THAT(scheduler_.workers().Remove(kAnn), IsEmpty());
  for (const GrantedLease& lease : after)
    EXPECT_TRUE(scheduler_.units().HoldsLease(kBen, lease.unit, lease.attempt));
}

TEST_F(RegrantTest, AnInstanceOfAnotherNameIsAnotherProcess) {
  scheduler_.jobs().Add(kJob, Spec());
  AddWorker(kAnn, 4, kProcess);
  const auto before = scheduler_.GrantLeases(kStart);
  AddWorker(kBen, 4, kProcess, "ben");
  for (const GrantedLease& lease : before)
    EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, lease.unit, lease.attempt));
}

TEST_F(RegrantTest, ConnectionsThatBreakAgainAndAgainAreNoLosses) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int i = 1; i <= 20;
       ++i) {  // as losses, these would put the unit into quarantine and then fail the job
    AddWorker(WorkerId(i), 1, kProcess);
    const auto leases = Regrant(WorkerId(i), {Pass(2, 1)});
    ASSERT_THAT(leases, SizeIs(1)) << i;
    EXPECT_FALSE(leases[0].alone);
    // Half of them before the next one connects, half of them after.
    if (i % 2 == 1) continue;
    EXPECT_THAT(scheduler_.workers().Remove(WorkerId(i)), IsEmpty());
    EXPECT_THAT(scheduler_.workers().Remove(WorkerId(i - 1)), IsEmpty());
  }
}

}  // namespace
}  // namespace lumifold::scheduler
