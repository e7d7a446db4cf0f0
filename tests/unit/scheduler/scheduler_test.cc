#include "server/scheduler/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

namespace lumifold::scheduler {
namespace {

using job::Attempt;
using job::FrameUnits;
using job::JobId;
using job::UnitKey;
using job::UnitRef;
using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const JobId kJob("j-1");
const JobId kOther("j-2");
const WorkerId kAnn(1);
const WorkerId kBen(2);
const absl::Time kStart = absl::FromUnixSeconds(1'000'000);

v1::JobSpec Spec(int frames = 1) {
  v1::JobSpec spec;
  spec.set_width(16);
  spec.set_height(16);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(8);
  spec.set_pass_samples(4);
  spec.set_first_frame(10);
  spec.set_frame_count(frames);
  return spec;  // 4 tiles x (1 + 2) units per frame
}

class SchedulerTest : public ::testing::Test {
 protected:
  Scheduler scheduler_{{.lease = absl::Seconds(30), .max_failures = 3, .first_attempt = Attempt(100)}};

  /// Delivers and commits a unit; true if it was the last one of its frame.
  bool Commit(WorkerId worker, const GrantedLease& lease) {
    EXPECT_EQ(scheduler_.CompleteUnit(worker, lease.unit, lease.attempt, kStart), Completion::kAccepted);
    return scheduler_.UnitCommitted(lease.unit);
  }
};

TEST_F(SchedulerTest, GrantsAsManyAsTheWorkerHasSlots) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 3});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(leases.size(), 3u);
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_EQ(leases[0].unit, (UnitRef{kJob, {10, 0, 0, v1::UNIT_KIND_GEOMETRY}}));
  EXPECT_EQ(leases[0].attempt, Attempt(100));
  EXPECT_EQ(leases[1].rect, (Rect{8, 0, 16, 8}));
  EXPECT_LT(leases[0].attempt, leases[1].attempt);
}

TEST_F(SchedulerTest, GrantsToAllWorkersInTheOrderTheyCameWhileThereIsWork) {
  scheduler_.AddJob(kJob, Spec());  // 12 units
  for (int i = 1; i <= 4; ++i) scheduler_.AddWorker(WorkerId(i), {.numeric_class = "avx2", .slots = 4});
  scheduler_.AddWorker(WorkerId(5), {.numeric_class = "sse2", .slots = 4});
  scheduler_.AddJob(kOther, Spec(), {.numeric_class = "sse2"});
  const auto leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 16u);
  for (size_t i = 0; i < leases.size(); ++i) {
    EXPECT_EQ(leases[i].worker, WorkerId(i < 12 ? 1 + static_cast<int64_t>(i) / 4 : 5));
    EXPECT_EQ(leases[i].unit.job, i < 12 ? kJob : kOther);
  }
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.RemoveWorker(WorkerId(1));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).worker, WorkerId(4));
}

TEST_F(SchedulerTest, AUnitThatAFreeWorkerMayNotTakeDoesNotStopTheOthers) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 12});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.AddJob(kOther, Spec());
  ASSERT_EQ(scheduler_.GrantLeases(kBen, kStart).size(), 1u);  // of the other job
  scheduler_.FailUnit(kAnn, leases[3].unit, leases[3].attempt, false, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  const auto next = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(next.size(), 1u);
  EXPECT_EQ(next[0].unit.job, kOther);
}

TEST_F(SchedulerTest, ASlotIsFreeOnceTheUnitIsCommittedAndNotBefore) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, lease.unit, lease.attempt, kStart), Completion::kAccepted);
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_FALSE(scheduler_.UnitCommitted(lease.unit));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).size(), 1u);
}

TEST_F(SchedulerTest, AJobThatEndsWithFreeUnitsLeavesNothingToOthersLikeIt) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddJob(kOther, Spec());
  scheduler_.EndJob(kJob);
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 12u);
  for (const GrantedLease& lease : leases) EXPECT_EQ(lease.unit.job, kOther);
}

TEST_F(SchedulerTest, ARevokedUnitIsLeasedOnceMore) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 12});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_FALSE(scheduler_.RevokeUnit(leases[5].unit)) << "it is leased, not committed";
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.CommittedFrames(kJob), ElementsAre(10));
  const UnitRef lost = leases[5].unit;
  EXPECT_TRUE(scheduler_.RevokeUnit(lost));
  EXPECT_FALSE(scheduler_.RevokeUnit(lost));
  EXPECT_THAT(scheduler_.CommittedFrames(kJob), IsEmpty());
  EXPECT_EQ(scheduler_.Progress(kJob).units_done, 11);
  EXPECT_EQ(scheduler_.Progress(kJob).samples_done, 16 * 16 * 8 - 8 * 8 * 4);
  const auto again = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(again[0].unit, lost);
  EXPECT_TRUE(Commit(kAnn, again[0]));
  scheduler_.FrameFinished(kJob, 10);
  EXPECT_FALSE(scheduler_.RevokeUnit(lost));
}

TEST_F(SchedulerTest, AUnitRevokedBeforeItsTurnIsLeasedOnceMore) {
  scheduler_.AddJob(kJob, Spec());
  const UnitRef lost{kJob, {10, 2, 0, v1::UNIT_KIND_GEOMETRY}};
  scheduler_.RestoreCommittedUnit(lost.job, {lost.key}, kStart);
  EXPECT_TRUE(scheduler_.RevokeUnit(lost));
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 100});
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).size(), 12u);
}

TEST_F(SchedulerTest, AUnitIsAcceptedOnce) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  Commit(kAnn, lease);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, lease.unit, lease.attempt, kStart), Completion::kDuplicate);
  EXPECT_EQ(scheduler_.Progress(kJob).units_done, 1);
}

TEST_F(SchedulerTest, AnotherWorkersLeaseIsStale) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.CompleteUnit(kBen, lease.unit, lease.attempt, kStart), Completion::kStale);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, lease.unit, Attempt(99), kStart), Completion::kStale);
}

TEST_F(SchedulerTest, UnknownUnitsAreUnknown) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  for (const UnitRef& unit :
       {UnitRef{kOther, {10, 0, 0, v1::UNIT_KIND_PASS}}, UnitRef{kJob, {11, 0, 0, v1::UNIT_KIND_PASS}},
        UnitRef{kJob, {9, 0, 0, v1::UNIT_KIND_PASS}}, UnitRef{kJob, {10, 4, 0, v1::UNIT_KIND_PASS}},
        UnitRef{kJob, {10, 0, 2, v1::UNIT_KIND_PASS}}}) {
    EXPECT_EQ(scheduler_.CompleteUnit(kAnn, unit, Attempt(100), kStart), Completion::kUnknown)
        << Describe(unit);
  }
}

TEST_F(SchedulerTest, LeasesOfAWorkerThatIsGoneGoToTheNext) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto lost = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.RemoveWorker(kAnn);
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 2});
  const auto again = scheduler_.GrantLeases(kBen, kStart);
  ASSERT_EQ(again.size(), 2u);
  EXPECT_EQ(again[0].unit, lost[0].unit);
  EXPECT_GT(again[0].attempt, lost[1].attempt);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, lost[0].unit, lost[0].attempt, kStart), Completion::kStale);
  EXPECT_EQ(scheduler_.CompleteUnit(kBen, again[0].unit, again[0].attempt, kStart), Completion::kAccepted);
}

TEST_F(SchedulerTest, LeasesRunOutUnlessRenewed) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(30));
  scheduler_.Heartbeat(kAnn, {{leases[0].unit, leases[0].attempt}}, Attempt(0), kStart + absl::Seconds(20));
  EXPECT_THAT(scheduler_.ExpireLeases(kStart + absl::Seconds(29)), IsEmpty());
  const auto expired = scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  ASSERT_EQ(expired.size(), 1u);
  EXPECT_EQ(expired[0].unit, leases[1].unit);
  EXPECT_TRUE(scheduler_.HoldsLease(kAnn, leases[0].unit, leases[0].attempt));
  EXPECT_FALSE(scheduler_.HoldsLease(kAnn, leases[1].unit, leases[1].attempt));
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(50));
}

TEST_F(SchedulerTest, ASilentWorkerGetsNothingUntilItIsHeardOf) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart + absl::Seconds(31)), IsEmpty());
  scheduler_.Heartbeat(kAnn, {}, Attempt(0), kStart + absl::Seconds(32));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart + absl::Seconds(32)).size(), 1u);
}

TEST_F(SchedulerTest, AHeartbeatVoidsWhatItDoesNotNameButNothingNewer) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 3});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.Heartbeat(kAnn, {{leases[0].unit, leases[0].attempt}}, leases[1].attempt, kStart);
  EXPECT_TRUE(scheduler_.HoldsLease(kAnn, leases[0].unit, leases[0].attempt));
  EXPECT_FALSE(scheduler_.HoldsLease(kAnn, leases[1].unit, leases[1].attempt));
  EXPECT_TRUE(scheduler_.HoldsLease(kAnn, leases[2].unit, leases[2].attempt));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, leases[1].unit);
}

TEST_F(SchedulerTest, ALeaseWithoutProgressIsNotRenewedForEver) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  const GrantedLease& moving = leases[0];
  const GrantedLease& hung = leases[1];
  absl::Time now = kStart;
  std::vector<LateLease> late;
  for (int64_t progress = 1; late.empty(); ++progress) {
    now += absl::Seconds(5);
    ASSERT_LE(now, kStart + absl::Minutes(10));
    scheduler_.Heartbeat(kAnn, {{moving.unit, moving.attempt, progress}, {hung.unit, hung.attempt, 0}},
                         hung.attempt, now);
    late = scheduler_.ExpireLeases(now);
  }
  EXPECT_EQ(now, kStart + absl::Minutes(10));
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, hung.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kStalled);
  EXPECT_TRUE(scheduler_.HoldsLease(kAnn, moving.unit, moving.attempt));
  EXPECT_FALSE(scheduler_.HoldsLease(kAnn, hung.unit, hung.attempt));
}

TEST_F(SchedulerTest, AStalledLeaseKeepsItsSlotWhileTheWorkerNamesIt) {
  Scheduler scheduler({.stall = absl::Seconds(40)});
  scheduler.AddJob(kJob, Spec());
  scheduler.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease hung = scheduler.GrantLeases(kAnn, kStart).at(0);
  scheduler.Heartbeat(kAnn, {{hung.unit, hung.attempt}}, hung.attempt, kStart + absl::Seconds(20));
  EXPECT_EQ(scheduler.NextExpiry(), kStart + absl::Seconds(40));
  const absl::Time now = kStart + absl::Seconds(40);
  EXPECT_EQ(scheduler.ExpireLeases(now).size(), 1u);
  scheduler.Heartbeat(kAnn, {{hung.unit, hung.attempt}}, hung.attempt, now);
  EXPECT_THAT(scheduler.GrantLeases(kAnn, now), IsEmpty());
  scheduler.Heartbeat(kAnn, {}, hung.attempt, now);
  EXPECT_EQ(scheduler.GrantLeases(kAnn, now).size(), 1u);
}

TEST_F(SchedulerTest, AnOverdueUnitIsLeasedToASecondWorkerAndTheFirstResultCounts) {
  v1::JobSpec spec = Spec();
  spec.set_width(64);  // 16 tiles
  scheduler_.AddJob(kJob, spec);
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease slow = scheduler_.GrantLeases(kAnn, kStart).at(0);
  absl::Time now = kStart;
  for (int i = 0; i < 8; ++i) {
    const GrantedLease lease = scheduler_.GrantLeases(kBen, now).at(0);
    EXPECT_NE(lease.unit, slow.unit);
    now += absl::Seconds(3);
    EXPECT_EQ(scheduler_.CompleteUnit(kBen, lease.unit, lease.attempt, now), Completion::kAccepted);
    scheduler_.UnitCommitted(lease.unit);
    scheduler_.Heartbeat(kAnn, {{slow.unit, slow.attempt, i}}, slow.attempt, now);
  }
  const std::vector<LateLease> late = scheduler_.ExpireLeases(now);  // 24 s are more than 4 x 3 s
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, slow.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kOverdue);
  EXPECT_TRUE(scheduler_.HoldsLease(kAnn, slow.unit, slow.attempt));
  const GrantedLease again = scheduler_.GrantLeases(now).at(0);
  EXPECT_EQ(again.worker, kBen);
  EXPECT_EQ(again.unit, slow.unit);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, slow.unit, slow.attempt, now), Completion::kAccepted);
  EXPECT_EQ(scheduler_.CompleteUnit(kBen, again.unit, again.attempt, now), Completion::kDuplicate);
  scheduler_.UnitCommitted(slow.unit);
  for (const GrantedLease& lease : scheduler_.GrantLeases(now)) EXPECT_NE(lease.unit, slow.unit);
}

TEST_F(SchedulerTest, AnOverdueUnitIsNotLeasedTwiceToTheSameWorker) {
  v1::JobSpec spec = Spec();
  spec.set_samples_per_pixel(12);  // 3 passes of 4 tiles
  scheduler_.AddJob(kJob, spec);
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 16});
  std::vector<GrantedLease> leases = scheduler_.GrantLeases(kAnn, kStart);
  const absl::Time now = kStart + absl::Seconds(1);
  for (size_t i = 0; i + 1 < leases.size(); ++i) {
    scheduler_.CompleteUnit(kAnn, leases[i].unit, leases[i].attempt, now);
    scheduler_.UnitCommitted(leases[i].unit);
  }
  EXPECT_EQ(scheduler_.ExpireLeases(kStart + absl::Seconds(9)).size(), 0u);
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(10));
  EXPECT_EQ(scheduler_.ExpireLeases(kStart + absl::Seconds(10)).size(), 1u);
  EXPECT_THAT(scheduler_.GrantLeases(kStart + absl::Seconds(10)), IsEmpty());
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(30));
}

TEST_F(SchedulerTest, AJobStaysWithinTheClassOfItsFirstAcceptedUnit) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx512", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  const GrantedLease other = scheduler_.GrantLeases(kBen, kStart).at(0);
  EXPECT_EQ(scheduler_.NumericClassOf(kJob), "");
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, first.unit, first.attempt, kStart), Completion::kAccepted);
  EXPECT_EQ(scheduler_.NumericClassOf(kJob), "avx2");
  EXPECT_EQ(scheduler_.CompleteUnit(kBen, other.unit, other.attempt, kStart), Completion::kStale);
  EXPECT_THAT(scheduler_.GrantLeases(kBen, kStart), IsEmpty());
  scheduler_.UnitCommitted(first.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, other.unit);
  scheduler_.AddJob(kOther, Spec());
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit.job, kOther);
}

TEST_F(SchedulerTest, AWorkerOfAnotherClassThatLeasesOnceAndDiesDoesNotBlockTheJob) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "sse2", .slots = 1});
  scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_RUNNING);
  scheduler_.RemoveWorker(kAnn);
  EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_PLANNED);
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 12});
  for (const GrantedLease& lease : scheduler_.GrantLeases(kBen, kStart)) Commit(kBen, lease);
  EXPECT_THAT(scheduler_.CommittedFrames(kJob), ElementsAre(10));
}

TEST_F(SchedulerTest, AFailedUnitGoesToAnotherWorkerWhereThereIsOne) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.FailUnit(kAnn, failed.unit, failed.attempt, false, kStart), FailureOutcome::kRetried);
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  EXPECT_NE(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, failed.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, failed.unit);
}

TEST_F(SchedulerTest, AWorkerThatFailedAUnitAndReconnectsIsStillTheSame) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.name = "bad", .numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.name = "good", .numeric_class = "avx2", .slots = 1});
  const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
  scheduler_.FailUnit(kAnn, failed.unit, failed.attempt, false, kStart);
  scheduler_.RemoveWorker(kAnn);
  const WorkerId again(3);
  scheduler_.AddWorker(again, {.name = "bad", .numeric_class = "avx2", .slots = 1});
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  EXPECT_NE(scheduler_.GrantLeases(again, kStart).at(0).unit, failed.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, failed.unit);
}

TEST_F(SchedulerTest, ADroppedUnitGoesToAnotherWorkerWhereThereIsOne) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  const std::vector<LateLease> late = scheduler_.Heartbeat(kAnn, {}, first.attempt, kStart);
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, first.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kDropped);
  EXPECT_EQ(late[0].job_error, "");
  const GrantedLease again = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(again.unit, first.unit) << "there is no other worker";
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  scheduler_.Heartbeat(kAnn, {}, again.attempt, kStart);
  EXPECT_NE(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, first.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit, first.unit);
}

TEST_F(SchedulerTest, ThreeFailuresOfAUnitFailTheJobWithLongerAndLongerPauses) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 12});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  GrantedLease lease = leases[0];
  absl::Time now = kStart;
  for (const absl::Duration pause : {absl::Seconds(1), absl::Seconds(2)}) {
    EXPECT_EQ(scheduler_.FailUnit(kAnn, lease.unit, lease.attempt, false, now), FailureOutcome::kRetried);
    EXPECT_EQ(scheduler_.FailUnit(kAnn, lease.unit, lease.attempt, false, now), FailureOutcome::kIgnored);
    EXPECT_EQ(scheduler_.NextExpiry(), now + pause);
    scheduler_.ExpireLeases(now + pause - absl::Milliseconds(1));
    EXPECT_THAT(scheduler_.GrantLeases(now), IsEmpty());
    now += pause;
    scheduler_.ExpireLeases(now);
    const auto again = scheduler_.GrantLeases(now);
    ASSERT_EQ(again.size(), 1u);
    EXPECT_EQ(again[0].unit, lease.unit);
    lease = again[0];
  }
  EXPECT_EQ(scheduler_.FailUnit(kAnn, lease.unit, lease.attempt, false, now), FailureOutcome::kJobFails);
}

TEST_F(SchedulerTest, APermanentFailureFailsTheJobAtOnceIfNobodyElseCanBeAsked) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.FailUnit(kAnn, lease.unit, lease.attempt, true, kStart), FailureOutcome::kJobFails);
}

TEST_F(SchedulerTest, APermanentFailureIsBelievedWhenASecondWorkerAgrees) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.FailUnit(kAnn, first.unit, first.attempt, true, kStart), FailureOutcome::kRetried);
  const GrantedLease second = scheduler_.GrantLeases(kBen, kStart).at(0);
  EXPECT_EQ(second.unit, first.unit) << "the second opinion is asked for at once";
  EXPECT_EQ(scheduler_.FailUnit(kBen, second.unit, second.attempt, true, kStart), FailureOutcome::kJobFails);
}

TEST_F(SchedulerTest, AWorkerThatFailsWhatOthersRenderIsSetAsideForAWhile) {
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  for (const JobId& job : {kJob, kOther}) {
    scheduler_.AddJob(job, Spec());
    const GrantedLease failed = scheduler_.GrantLeases(kAnn, kStart).at(0);
    if (job == kJob) scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 12});
    scheduler_.FailUnit(kAnn, failed.unit, failed.attempt, true, kStart);
    EXPECT_EQ(scheduler_.SetAsideReason(kAnn), "");
    for (const GrantedLease& lease : scheduler_.GrantLeases(kBen, kStart)) Commit(kBen, lease);
    if (job == kJob) {
      EXPECT_THAT(scheduler_.TakeSetAside(), IsEmpty()) << "one job may be to blame itself";
      scheduler_.EndJob(job);
    }
  }
  const std::vector<SetAsideWorker> aside = scheduler_.TakeSetAside();
  ASSERT_EQ(aside.size(), 1u);
  EXPECT_EQ(aside[0].worker, kAnn);
  EXPECT_EQ(aside[0].until, kStart + absl::Minutes(5));
  EXPECT_EQ(aside[0].reason, "it failed units of 2 jobs that other workers rendered");
  EXPECT_EQ(scheduler_.SetAsideReason(kAnn), aside[0].reason);
  scheduler_.AddJob(kJob, Spec());
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Minutes(5));
  scheduler_.ExpireLeases(kStart + absl::Minutes(5));
  EXPECT_EQ(scheduler_.SetAsideReason(kAnn), "");
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart + absl::Minutes(5)).size(), 1u);
}

TEST_F(SchedulerTest, AUnitThatCrashesWorkersRunsAloneAndThenItsJobFails) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(WorkerId(1), {.name = "host:1", .numeric_class = "avx2", .slots = 1});
  const UnitRef poison = scheduler_.GrantLeases(kStart).at(0).unit;
  for (int64_t i = 2; i <= 3; ++i) {
    EXPECT_THAT(scheduler_.RemoveWorker(WorkerId(i - 1)), IsEmpty());
    scheduler_.AddWorker(WorkerId(i),
                         {.name = absl::StrCat("host:", i), .numeric_class = "avx2", .slots = 1});
    EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).unit, poison);
  }
  scheduler_.RemoveWorker(WorkerId(3));
  scheduler_.AddWorker(WorkerId(4), {.name = "host:4", .numeric_class = "avx2", .slots = 3});
  scheduler_.AddWorker(WorkerId(5), {.name = "host:5", .numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 3u);
  EXPECT_EQ(leases[0].unit, poison);
  EXPECT_EQ(leases[0].worker, WorkerId(4));
  EXPECT_TRUE(leases[0].alone);
  EXPECT_EQ(leases[1].worker, WorkerId(5)) << "the worker in quarantine gets nothing else";
  const std::vector<FailedJob> failed = scheduler_.RemoveWorker(WorkerId(4));
  ASSERT_EQ(failed.size(), 1u);
  EXPECT_EQ(failed[0].job, kJob);
  EXPECT_THAT(failed[0].error, HasSubstr("j-1 frame 10 tile 0 geometry: workers were lost with it 4 times"));
  EXPECT_THAT(failed[0].error, HasSubstr("host:1, host:2, host:3, host:4"));
}

TEST_F(SchedulerTest, AUnitInQuarantineThatIsRenderedIsCommittedLikeAnyOther) {
  scheduler_.AddJob(kJob, Spec());
  for (int64_t i = 1; i <= 3; ++i) {
    scheduler_.AddWorker(WorkerId(i), {.numeric_class = "avx2", .slots = 2});
    scheduler_.GrantLeases(kStart);
    scheduler_.RemoveWorker(WorkerId(i));
  }
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  for (int i = 0; i < 2; ++i) {
    const auto alone = scheduler_.GrantLeases(kStart);
    ASSERT_EQ(alone.size(), 1u);
    EXPECT_TRUE(alone[0].alone);
    EXPECT_EQ(alone[0].unit.key.tile, i);
    EXPECT_FALSE(Commit(kAnn, alone[0]));
  }
  const auto others = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(others.size(), 2u);
  EXPECT_FALSE(others[0].alone);
}

TEST_F(SchedulerTest, AUnitInQuarantineWaitsUntilItsWorkerIsIdle) {
  scheduler_.AddJob(kOther, Spec());
  scheduler_.AddWorker(WorkerId(9), {.numeric_class = "avx2", .slots = 2});
  const GrantedLease busy = scheduler_.GrantLeases(kStart).at(0);
  for (int64_t i = 1; i <= 3; ++i) {
    scheduler_.AddWorker(WorkerId(i), {.numeric_class = "avx2", .slots = 1});
    scheduler_.GrantLeases(kStart);
    scheduler_.RemoveWorker(WorkerId(i));
  }
  scheduler_.AddJob(kJob, Spec());
  Commit(WorkerId(9), busy);  // one slot is free, the other one is not
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.EndJob(kOther);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 2u) << "the unit in quarantine has ended with its job";
}

TEST_F(SchedulerTest, AWorkerThatIsLostWithItsUnitAgainAndAgainCountsAsSeveral) {
  scheduler_.AddJob(kJob, Spec());
  for (int64_t i = 1; i <= 6; ++i) {
    scheduler_.AddWorker(WorkerId(i), {.name = "restarted", .numeric_class = "avx2", .slots = 1});
    EXPECT_FALSE(scheduler_.GrantLeases(kStart).at(0).alone);
    scheduler_.RemoveWorker(WorkerId(i));
  }
  scheduler_.AddWorker(WorkerId(7), {.name = "restarted", .numeric_class = "avx2", .slots = 1});
  EXPECT_TRUE(scheduler_.GrantLeases(kStart).at(0).alone);
}

TEST_F(SchedulerTest, AnEndedJobIsForgottenAndItsSlotsAreFree) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddJob(kOther, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.CompleteUnit(kAnn, leases[0].unit, leases[0].attempt, kStart);
  scheduler_.EndJob(kJob);
  EXPECT_FALSE(scheduler_.HasJob(kJob));
  EXPECT_FALSE(scheduler_.UnitCommitted(leases[0].unit));
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, leases[1].unit, leases[1].attempt, kStart), Completion::kUnknown);
  const auto next = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(next.size(), 2u);
  EXPECT_EQ(next[0].unit.job, kOther);
}

TEST_F(SchedulerTest, StatesFollowTheWork) {
  scheduler_.AddJob(kJob, Spec(/*frames=*/2));
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 12});
  EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_PLANNED);
  for (const int32_t frame : {10, 11}) {
    const auto leases = scheduler_.GrantLeases(kAnn, kStart);
    ASSERT_EQ(leases.size(), 12u);
    EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_RUNNING);
    EXPECT_EQ(scheduler_.Progress(kJob).workers, 1);
    for (size_t i = 0; i < leases.size(); ++i) {
      EXPECT_EQ(leases[i].unit.key.frame, frame);
      EXPECT_EQ(Commit(kAnn, leases[i]), i + 1 == leases.size());
    }
    EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_FILTERING);
    EXPECT_THAT(scheduler_.CommittedFrames(kJob), ElementsAre(frame));
    EXPECT_EQ(scheduler_.FrameFinished(kJob, frame), frame == 11);
    EXPECT_THAT(scheduler_.CommittedFrames(kJob), IsEmpty());
  }
  const JobProgress progress = scheduler_.Progress(kJob);
  EXPECT_EQ(progress.state, v1::JOB_STATE_DONE);
  EXPECT_EQ(progress.units_done, progress.units_total);
  EXPECT_EQ(progress.samples_done, 2 * 16 * 16 * 8);
  EXPECT_EQ(progress.samples_done, progress.samples_total);
}

TEST_F(SchedulerTest, RestoredUnitsAreNotRenderedAgain) {
  scheduler_.AddJob(kJob, Spec(/*frames=*/3), {.numeric_class = "avx2"});
  EXPECT_TRUE(scheduler_.RestoreFinishedFrame(kJob, 10));
  EXPECT_TRUE(scheduler_.RestoreCommittedUnit(kJob, {{10, 1, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_TRUE(scheduler_.RestoreCommittedUnit(kJob, {{11, 0, 0, v1::UNIT_KIND_GEOMETRY}}, kStart));
  EXPECT_TRUE(scheduler_.RestoreCommittedUnit(kJob, {{11, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_TRUE(scheduler_.RestoreCommittedUnit(kJob, {{11, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_FALSE(scheduler_.RestoreCommittedUnit(kJob, {{13, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_EQ(scheduler_.Progress(kJob).units_done, 12 + 2);
  scheduler_.AddWorker(kBen, {.numeric_class = "sse2", .slots = 100});
  EXPECT_THAT(scheduler_.GrantLeases(kBen, kStart), IsEmpty());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(leases.size(), 12u - 2 + 12);
  for (const GrantedLease& lease : leases) {
    EXPECT_NE(lease.unit.key, (UnitKey{11, 0, 0, v1::UNIT_KIND_GEOMETRY}));
    EXPECT_NE(lease.unit.key, (UnitKey{11, 2, 1, v1::UNIT_KIND_PASS}));
    EXPECT_NE(lease.unit.key.frame, 10);
  }
}

TEST_F(SchedulerTest, AFrameCommittedBeforeARestartAwaitsItsFinish) {
  scheduler_.AddJob(kJob, Spec(), {.numeric_class = "avx2"});
  const FrameUnits units(Spec());
  for (int64_t number = 0; number < units.count(); ++number) {
    scheduler_.RestoreCommittedUnit(kJob, {units.KeyOf(10, number)}, kStart);
  }
  EXPECT_THAT(scheduler_.CommittedFrames(kJob), ElementsAre(10));
  EXPECT_TRUE(scheduler_.FrameFinished(kJob, 10));
}

TEST_F(SchedulerTest, AHugeFrameTakesBitsAndNotMegabytesAndGrantsInTime) {
  v1::JobSpec spec = Spec();
  spec.set_width(16384);
  spec.set_height(8192);
  spec.set_tile_size(32);
  spec.set_samples_per_pixel(4096);
  spec.set_pass_samples(64);
  scheduler_.AddJob(kJob, spec);
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1000});
  EXPECT_EQ(scheduler_.Progress(kJob).units_total, 131072 * 65);
  int64_t committed = 0;
  for (int round = 0; round < 100; ++round) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(kAnn, kStart)) {
      Commit(kAnn, lease);
      ++committed;
    }
  }
  EXPECT_EQ(committed, 100'000);
  EXPECT_EQ(scheduler_.Progress(kJob).units_done, committed);
}

TEST_F(SchedulerTest, TagsAndThePinnedClassSayWhoMayRenderAJob) {
  scheduler_.AddJob(kJob, Spec(), {.tags = {"night", "gpu"}, .numeric_class = "avx2"});
  scheduler_.AddWorker(WorkerId(1), {.numeric_class = "avx2", .slots = 1, .tags = {"gpu"}});
  scheduler_.AddWorker(WorkerId(2), {.numeric_class = "sse2", .slots = 1, .tags = {"gpu", "night"}});
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.AddWorker(WorkerId(3), {.numeric_class = "avx2", .slots = 1, .tags = {"x", "night", "gpu"}});
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).worker, WorkerId(3));
}

TEST_F(SchedulerTest, APausedJobGetsNoLeasesButKeepsThoseItHas) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kStart);
  scheduler_.PauseJob(kJob);
  EXPECT_EQ(scheduler_.Progress(kJob).state, v1::JOB_STATE_PAUSED);
  EXPECT_FALSE(Commit(kAnn, leases[0]));
  scheduler_.FailUnit(kAnn, leases[1].unit, leases[1].attempt, false, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.ResumeJob(kJob);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 2u);
  scheduler_.AddJob(kOther, Spec(), {.paused = true});
  EXPECT_EQ(scheduler_.Progress(kOther).state, v1::JOB_STATE_PAUSED);
}

TEST_F(SchedulerTest, AJobHasNoMoreLeasesThanItsLimit) {
  scheduler_.AddJob(kJob, Spec(), {.max_leases = 3});
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 5});
  const auto leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 3u);
  Commit(kAnn, leases[0]);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
}

TEST_F(SchedulerTest, ALeaseThatIsHandedBackIsFreeAtOnceAndNobodyIsToBlame) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  for (int i = 0; i < 20; ++i) {  // more often than failures or losses would be allowed
    EXPECT_TRUE(scheduler_.HandBack(kAnn, lease.unit, lease.attempt));
    EXPECT_FALSE(scheduler_.HandBack(kAnn, lease.unit, lease.attempt));
    const GrantedLease again = scheduler_.GrantLeases(kStart).at(0);
    EXPECT_EQ(again.unit, lease.unit);
    EXPECT_FALSE(again.alone);
    lease = again;
  }
  EXPECT_EQ(scheduler_.DescribeWorker(kAnn)->units_failed, 0);
  EXPECT_THAT(scheduler_.TakeVoided(), IsEmpty()) << "the worker knows";
}

TEST_F(SchedulerTest, ADrainedWorkerFinishesWhatItHas) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 2});
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  scheduler_.DrainWorker(kAnn);
  EXPECT_EQ(scheduler_.DescribeWorker(kAnn)->state, v1::WORKER_STATE_DRAINING);
  Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_TRUE(scheduler_.ReadmitWorker("ann"));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
}

TEST_F(SchedulerTest, ABlockedWorkerLosesItsLeasesAndGetsNoneUnderAnyConnection) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 2});
  scheduler_.AddWorker(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kStart);
  scheduler_.BlockWorker("ann", "wrong pixels");
  const std::vector<VoidedLease> voided = scheduler_.TakeVoided();
  ASSERT_EQ(voided.size(), 2u);
  EXPECT_EQ(voided[0].worker, kAnn);
  EXPECT_EQ(voided[0].attempt, leases[0].attempt);
  EXPECT_EQ(scheduler_.CompleteUnit(kAnn, leases[0].unit, leases[0].attempt, kStart), Completion::kStale);
  scheduler_.RemoveWorker(kAnn);
  ASSERT_EQ(scheduler_.Blocked().size(), 1u);
  EXPECT_EQ(scheduler_.Blocked()[0].reason, "wrong pixels");
  scheduler_.AddWorker(WorkerId(3), {.name = "ann", .numeric_class = "avx2", .slots = 2});
  EXPECT_EQ(scheduler_.DescribeWorker(WorkerId(3))->state, v1::WORKER_STATE_BLOCKED);
  EXPECT_EQ(scheduler_.DescribeWorker(WorkerId(3))->reason, "wrong pixels");
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_TRUE(scheduler_.ReadmitWorker("ann"));
  EXPECT_FALSE(scheduler_.ReadmitWorker("nobody"));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).unit, leases[0].unit);
}

TEST_F(SchedulerTest, NoMoreFramesAreActiveThanTheirLimit) {
  scheduler_.SetMaxActiveFrames(2);
  scheduler_.AddJob(kJob, Spec(/*frames=*/4));
  scheduler_.AddJob(kOther, Spec(/*frames=*/2));
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 24u);
  EXPECT_EQ(scheduler_.active_frames(), 2);
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty()) << "the frames are not written";
  EXPECT_EQ(scheduler_.Explain(leases[0].unit.job, kStart).at(0).code, "frames_in_flight");
  scheduler_.FrameFinished(leases[0].unit.job, leases[0].unit.key.frame);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 12u);
}

TEST_F(SchedulerTest, FramesThatNobodyCanFinishDoNotStopTheOthers) {
  scheduler_.SetMaxActiveFrames(1);
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.GrantLeases(kStart);
  scheduler_.AddJob(kOther, Spec());
  scheduler_.AddWorker(kBen, {.numeric_class = "avx2", .slots = 12});
  scheduler_.PauseJob(kJob);
  EXPECT_EQ(scheduler_.active_frames(), 0);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).unit.job, kOther) << "a paused job's frame does not count";
  scheduler_.EndJob(kOther);
  scheduler_.ResumeJob(kJob);
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) Commit(lease.worker, lease);
  scheduler_.RemoveWorker(kAnn);
  scheduler_.RemoveWorker(kBen);  // the job is bound to avx2, and its frame is not finished
  scheduler_.AddJob(kOther, Spec());
  scheduler_.AddWorker(WorkerId(3), {.numeric_class = "sse2", .slots = 1});
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u) << "nor one that no worker can render";
}

TEST_F(SchedulerTest, LeasesThatBecomeVoidBehindTheirWorkersBackAreReported) {
  scheduler_.AddJob(kJob, Spec());
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.AddWorker(kBen, {.numeric_class = "sse2", .slots = 1});
  const auto leases = scheduler_.GrantLeases(kStart);
  Commit(kAnn, leases[0]);
  std::vector<VoidedLease> voided = scheduler_.TakeVoided();
  ASSERT_EQ(voided.size(), 1u) << "the job is of the class avx2 now";
  EXPECT_EQ(voided[0].worker, kBen);
  EXPECT_EQ(voided[0].unit, leases[1].unit);
  const auto next = scheduler_.GrantLeases(kStart);
  scheduler_.EndJob(kJob);
  voided = scheduler_.TakeVoided();
  ASSERT_EQ(voided.size(), 1u);
  EXPECT_EQ(voided[0].attempt, next[0].attempt);
  EXPECT_THAT(scheduler_.TakeVoided(), IsEmpty());
}

std::vector<std::string> Codes(const std::vector<Reason>& reasons) {
  std::vector<std::string> codes;
  for (const Reason& reason : reasons) codes.push_back(reason.code);
  return codes;
}

TEST_F(SchedulerTest, ExplainsWhyAJobDoesNotRun) {
  scheduler_.AddJob(kJob, Spec(),
                    {.tags = {"gpu"}, .max_leases = 1, .numeric_class = "avx2", .paused = true});
  auto reasons = scheduler_.Explain(kJob, kStart);
  EXPECT_THAT(Codes(reasons), ElementsAre("paused", "no_worker"));
  EXPECT_THAT(reasons[1].text, HasSubstr("class avx2 with the tags gpu"));
  scheduler_.ResumeJob(kJob);
  const WorkerTraits traits{.name = "ann", .numeric_class = "avx2", .slots = 1, .tags = {"gpu"}};
  scheduler_.AddWorker(kAnn, traits);
  EXPECT_THAT(scheduler_.Explain(kJob, kStart), IsEmpty());
  scheduler_.DrainWorker(kAnn);
  EXPECT_THAT(Codes(scheduler_.Explain(kJob, kStart)), ElementsAre("worker_unavailable"));
  scheduler_.ReadmitWorker("ann");
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  EXPECT_THAT(Codes(scheduler_.Explain(kJob, kStart)), ElementsAre("max_leases"));
  scheduler_.FailUnit(kAnn, lease.unit, lease.attempt, false, kStart);
  reasons = scheduler_.Explain(kJob, kStart);
  EXPECT_THAT(Codes(reasons), ElementsAre("backoff"));
  EXPECT_THAT(reasons[0].text, HasSubstr("j-1 frame 10 tile 0 geometry, for 1 s"));
  EXPECT_THAT(scheduler_.Explain(JobId("j-none"), kStart), IsEmpty());
}

TEST_F(SchedulerTest, ExplainsThatTheSlotsAreBusyWithOtherJobs) {
  scheduler_.AddJob(kJob, Spec(), {.user = "ann"});
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 3});
  scheduler_.GrantLeases(kStart);
  scheduler_.AddJob(kOther, Spec(), {.user = "ben"});
  const auto reasons = scheduler_.Explain(kOther, kStart);
  ASSERT_THAT(Codes(reasons), ElementsAre("slots_busy"));
  EXPECT_THAT(reasons[0].text,
              HasSubstr("all 3 slots of the 1 workers that may render the job are busy: it has 0 "
                        "leases, user ann has 3, user ben has 0; the share of its user is 50 %"));
}

TEST_F(SchedulerTest, DescribesWorkersInPages) {
  scheduler_.AddJob(kJob, Spec());
  for (int i = 1; i <= 5; ++i) scheduler_.AddWorker(WorkerId(i), {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  scheduler_.CompleteUnit(kAnn, lease.unit, lease.attempt, kStart + absl::Seconds(4));
  const auto page = scheduler_.Workers(WorkerId(0), 2);
  ASSERT_EQ(page.size(), 2u);
  EXPECT_EQ(page[0].traits.name, "w-1");
  EXPECT_EQ(page[0].units_done, 1);
  EXPECT_EQ(page[0].mean_time, absl::Seconds(4));
  EXPECT_THAT(page[1].jobs, ElementsAre(kJob));
  EXPECT_EQ(page[1].state, v1::WORKER_STATE_BUSY);
  EXPECT_EQ(scheduler_.Workers(WorkerId(4), 10).size(), 1u);
  EXPECT_FALSE(scheduler_.DescribeWorker(WorkerId(9)).has_value());
}

TEST_F(SchedulerTest, FramesMayHaveGaps) {
  v1::JobSpec spec = Spec(/*frames=*/1);
  spec.add_more_frames()->set_first(20);
  spec.mutable_more_frames(0)->set_count(2);
  scheduler_.AddJob(kJob, spec);
  EXPECT_TRUE(scheduler_.RestoreFinishedFrame(kJob, 20));
  EXPECT_FALSE(scheduler_.RestoreFinishedFrame(kJob, 11));
  EXPECT_FALSE(scheduler_.RestoreCommittedUnit(kJob, {{19, 0, 0, v1::UNIT_KIND_GEOMETRY}}, kStart));
  scheduler_.AddWorker(kAnn, {.numeric_class = "avx2", .slots = 100});
  std::set<int32_t> frames;
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 24u);
  for (const GrantedLease& lease : leases) {
    frames.insert(lease.unit.key.frame);
    Commit(kAnn, lease);
  }
  EXPECT_EQ(frames, (std::set<int32_t>{10, 21}));
  EXPECT_THAT(scheduler_.CommittedFrames(kJob), ElementsAre(10, 21));
  EXPECT_FALSE(scheduler_.FrameFinished(kJob, 21));
  EXPECT_TRUE(scheduler_.FrameFinished(kJob, 10));
  EXPECT_EQ(scheduler_.Progress(kJob).frames_total, 3);
}

}  // namespace
}  // namespace lumifold::scheduler
