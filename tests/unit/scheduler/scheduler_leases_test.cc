#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using ::testing::IsEmpty;

using SchedulerLeasesTest = SchedulerFixture;

TEST_F(SchedulerLeasesTest, AUnitIsAcceptedOnce) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  Commit(kAnn, lease);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, lease.unit, lease.attempt, kStart), Completion::kDuplicate);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, 1);
}

TEST_F(SchedulerLeasesTest, AnotherWorkersLeaseIsStale) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.units().Complete(kBen, lease.unit, lease.attempt, kStart), Completion::kStale);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, lease.unit, Attempt(99), kStart), Completion::kStale);
}

TEST_F(SchedulerLeasesTest, LeasesOfAWorkerThatIsGoneGoToTheNext) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto lost = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.workers().Remove(kAnn);
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 2});
  const auto again = scheduler_.GrantLeases(kBen, kStart);
  ASSERT_EQ(again.size(), 2u);
  EXPECT_EQ(again[0].unit, lost[0].unit);
  EXPECT_GT(again[0].attempt, lost[1].attempt);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, lost[0].unit, lost[0].attempt, kStart), Completion::kStale);
  EXPECT_EQ(scheduler_.units().Complete(kBen, again[0].unit, again[0].attempt, kStart),
            Completion::kAccepted);
}

TEST_F(SchedulerLeasesTest, RetriesAreCountedByTheirReason) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  EXPECT_THAT(scheduler_.CountAll().retries, IsEmpty());
  GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_TRUE(scheduler_.units().HandBack(kAnn, lease.unit, lease.attempt));
  EXPECT_FALSE(scheduler_.units().HandBack(kAnn, lease.unit, lease.attempt));  // it counts once
  scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(scheduler_.ExpireLeases(kStart + absl::Seconds(30)).size(), 1u);
  EXPECT_EQ(scheduler_.CountAll().leases_expired, 1);
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  ASSERT_EQ(scheduler_.GrantLeases(kBen, kStart + absl::Seconds(30)).size(), 1u);
  scheduler_.workers().Remove(kBen);
  const std::map<RetryReason, int64_t> expected = {
      {RetryReason::kHandedBack, 1}, {RetryReason::kExpired, 1}, {RetryReason::kWorkerLost, 1}};
  EXPECT_EQ(scheduler_.CountAll().retries, expected);
}

TEST_F(SchedulerLeasesTest, LeasesRunOutUnlessRenewed) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(30));
  scheduler_.workers().Heartbeat(kAnn, {{leases[0].unit, leases[0].attempt}}, Attempt(0),
                                 kStart + absl::Seconds(20));
  EXPECT_THAT(scheduler_.ExpireLeases(kStart + absl::Seconds(29)), IsEmpty());
  const auto expired = scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  ASSERT_EQ(expired.size(), 1u);
  EXPECT_EQ(expired[0].unit, leases[1].unit);
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, leases[0].unit, leases[0].attempt));
  EXPECT_FALSE(scheduler_.units().HoldsLease(kAnn, leases[1].unit, leases[1].attempt));
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(50));
}

TEST_F(SchedulerLeasesTest, ASilentWorkerGetsNothingUntilItIsHeardOf) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart + absl::Seconds(31)), IsEmpty());
  scheduler_.workers().Heartbeat(kAnn, {}, Attempt(0), kStart + absl::Seconds(32));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart + absl::Seconds(32)).size(), 1u);
}

TEST_F(SchedulerLeasesTest, AHeartbeatVoidsWhatItDoesNotNameButNothingNewer) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 3});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.workers().Heartbeat(kAnn, {{leases[0].unit, leases[0].attempt}}, leases[1].attempt, kStart);
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, leases[0].unit, leases[0].attempt));
  EXPECT_FALSE(scheduler_.units().HoldsLease(kAnn, leases[1].unit, leases[1].attempt));
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, leases[2].unit, leases[2].attempt));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, leases[1].unit);
}

TEST_F(SchedulerLeasesTest, ALeaseWithoutProgressIsNotRenewedForEver) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  const GrantedLease& moving = leases[0];
  const GrantedLease& hung = leases[1];
  absl::Time now = kStart;
  std::vector<LateLease> late;
  for (int64_t progress = 1; late.empty(); ++progress) {
    now += absl::Seconds(5);
    ASSERT_LE(now, kStart + absl::Minutes(10));
    scheduler_.workers().Heartbeat(
        kAnn, {{moving.unit, moving.attempt, progress}, {hung.unit, hung.attempt, 0}}, hung.attempt, now);
    late = scheduler_.ExpireLeases(now);
  }
  EXPECT_EQ(now, kStart + absl::Minutes(10));
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, hung.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kStalled);
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, moving.unit, moving.attempt));
  EXPECT_FALSE(scheduler_.units().HoldsLease(kAnn, hung.unit, hung.attempt));
}

TEST_F(SchedulerLeasesTest, AStalledLeaseKeepsItsSlotWhileTheWorkerNamesIt) {
  Scheduler scheduler({.lease = absl::Seconds(41), .stall = absl::Seconds(40)});
  scheduler.jobs().Add(kJob, Spec());
  scheduler.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease hung = scheduler.GrantLeases(kAnn, kStart).at(0);
  scheduler.workers().Heartbeat(kAnn, {{hung.unit, hung.attempt}}, hung.attempt, kStart + absl::Seconds(20));
  EXPECT_EQ(scheduler.NextExpiry(), kStart + absl::Seconds(40));
  const absl::Time now = kStart + absl::Seconds(40);
  EXPECT_EQ(scheduler.ExpireLeases(now).size(), 1u);
  scheduler.workers().Heartbeat(kAnn, {{hung.unit, hung.attempt}}, hung.attempt, now);
  EXPECT_THAT(scheduler.GrantLeases(kAnn, now), IsEmpty());
  scheduler.workers().Heartbeat(kAnn, {}, hung.attempt, now);
  EXPECT_EQ(scheduler.GrantLeases(kAnn, now).size(), 1u);
}

TEST_F(SchedulerLeasesTest, AnOverdueUnitIsLeasedToASecondWorkerAndTheFirstResultCounts) {
  v1::JobSpec spec = Spec();
  spec.set_width(64);  // 16 tiles
  scheduler_.jobs().Add(kJob, spec);
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease slow = scheduler_.GrantLeases(kAnn, kStart).at(0);
  absl::Time now = kStart;
  for (int i = 0; i < 16; ++i) {  // 8 of them are geometry
    const GrantedLease lease = scheduler_.GrantLeases(kBen, now).at(0);
    EXPECT_NE(lease.unit, slow.unit);
    now += absl::Seconds(3);
    EXPECT_EQ(scheduler_.units().Complete(kBen, lease.unit, lease.attempt, now), Completion::kAccepted);
    scheduler_.units().Commit(lease.unit);
    scheduler_.workers().Heartbeat(kAnn, {{slow.unit, slow.attempt, i}}, slow.attempt, now);
  }
  const std::vector<LateLease> late = scheduler_.ExpireLeases(now);  // 48 s are more than 4 x 3 s
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, slow.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kOverdue);
  EXPECT_TRUE(scheduler_.units().HoldsLease(kAnn, slow.unit, slow.attempt));
  const GrantedLease again = scheduler_.GrantLeases(now).at(0);
  EXPECT_EQ(again.worker, kBen);
  EXPECT_EQ(again.unit, slow.unit);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, slow.unit, slow.attempt, now), Completion::kAccepted);
  EXPECT_EQ(scheduler_.units().Complete(kBen, again.unit, again.attempt, now), Completion::kDuplicate);
  scheduler_.units().Commit(slow.unit);
  for (const GrantedLease& lease : scheduler_.GrantLeases(now)) EXPECT_NE(lease.unit, slow.unit);
}

TEST_F(SchedulerLeasesTest, AnOverdueUnitIsNotLeasedTwiceToTheSameWorker) {
  v1::JobSpec spec = Spec();
  spec.set_samples_per_pixel(12);  // 3 passes of 4 tiles
  scheduler_.jobs().Add(kJob, spec);
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 16});
  std::vector<GrantedLease> leases = scheduler_.GrantLeases(kAnn, kStart);
  const absl::Time now = kStart + absl::Seconds(1);
  for (size_t i = 0; i + 1 < leases.size(); ++i) {
    scheduler_.units().Complete(kAnn, leases[i].unit, leases[i].attempt, now);
    scheduler_.units().Commit(leases[i].unit);
  }
  EXPECT_EQ(scheduler_.ExpireLeases(kStart + absl::Seconds(9)).size(), 0u);
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(10));
  EXPECT_EQ(scheduler_.ExpireLeases(kStart + absl::Seconds(10)).size(), 1u);
  EXPECT_THAT(scheduler_.GrantLeases(kStart + absl::Seconds(10)), IsEmpty());
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(30));
}

TEST_F(SchedulerLeasesTest, ALeaseThatIsHandedBackIsFreeAtOnceAndNobodyFailedIt) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  for (int i = 0; i < 20; ++i) {  // more often than failures or losses would be allowed
    EXPECT_TRUE(scheduler_.units().HandBack(kAnn, lease.unit, lease.attempt));
    EXPECT_FALSE(scheduler_.units().HandBack(kAnn, lease.unit, lease.attempt));
    const GrantedLease again = scheduler_.GrantLeases(kStart).at(0);
    EXPECT_EQ(again.unit, lease.unit);
    EXPECT_FALSE(again.alone);
    lease = again;
  }
  EXPECT_EQ(scheduler_.workers().Describe(kAnn)->units_failed, 0);
  EXPECT_THAT(scheduler_.units().TakeRevoked(), IsEmpty()) << "the worker knows";
}

TEST_F(SchedulerLeasesTest, LeasesThatBecomeVoidBehindTheirWorkersBackAreReported) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.numeric_class = "sse2", .slots = 1});
  const auto leases = scheduler_.GrantLeases(kStart);
  Commit(kAnn, leases[0]);
  std::vector<RevokedLease> revoked = scheduler_.units().TakeRevoked();
  ASSERT_EQ(revoked.size(), 1u) << "the job is of the class avx2 now";
  EXPECT_EQ(revoked[0].worker, kBen);
  EXPECT_EQ(revoked[0].unit, leases[1].unit);
  const auto next = scheduler_.GrantLeases(kStart);
  scheduler_.jobs().End(kJob);
  revoked = scheduler_.units().TakeRevoked();
  ASSERT_EQ(revoked.size(), 1u);
  EXPECT_EQ(revoked[0].attempt, next[0].attempt);
  EXPECT_THAT(scheduler_.units().TakeRevoked(), IsEmpty());
}

}  // namespace
}  // namespace lumifold::scheduler
