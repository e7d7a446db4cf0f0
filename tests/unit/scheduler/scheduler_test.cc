#include "server/scheduler/scheduler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "tests/unit/scheduler/scheduler_fixture.h"

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
using ::testing::SizeIs;

using SchedulerTest = SchedulerFixture;

TEST_F(SchedulerTest, GrantsAsManyAsTheWorkerHasSlots) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 3});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(leases.size(), 3u);
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_EQ(leases[0].unit, (UnitRef{kJob, {10, 0, 0, v1::UNIT_KIND_GEOMETRY}}));
  EXPECT_EQ(leases[0].attempt, Attempt(100));
  EXPECT_EQ(leases[2].rect, (Rect{8, 0, 16, 8}));
  EXPECT_LT(leases[0].attempt, leases[1].attempt);
}

TEST_F(SchedulerTest, GrantsToAllWorkersInTheOrderTheyCameWhileThereIsWork) {
  scheduler_.jobs().Add(kJob, Spec());  // 12 units
  for (int i = 1; i <= 4; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = 4});
  scheduler_.workers().Add(WorkerId(5), {.numeric_class = "sse2", .slots = 4});
  scheduler_.jobs().Add(kOther, Spec(), {.numeric_class = "sse2"});
  const auto leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 16u);
  for (size_t i = 0; i < leases.size(); ++i) {
    EXPECT_EQ(leases[i].worker, WorkerId(i < 12 ? 1 + static_cast<int64_t>(i) / 4 : 5));
    EXPECT_EQ(leases[i].unit.job, i < 12 ? kJob : kOther);
  }
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.workers().Remove(WorkerId(1));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).worker, WorkerId(4));
}

TEST_F(SchedulerTest, AUnitThatAFreeWorkerMayNotTakeDoesNotStopTheOthers) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 12});
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 1});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.jobs().Add(kOther, Spec());
  ASSERT_EQ(scheduler_.GrantLeases(kBen, kStart).size(), 1u);  // of the other job
  scheduler_.units().Fail(kAnn, leases[3].unit, leases[3].attempt, {}, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));  // the backoff is over
  const auto next = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(next.size(), 1u);
  EXPECT_EQ(next[0].unit.job, kOther);
}

TEST_F(SchedulerTest, ASlotIsFreeOnceTheUnitIsAcceptedUnlessTooManyBytesWait) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, first.unit, first.attempt, kStart), Completion::kAccepted);
  const GrantedLease lease = scheduler_.GrantLeases(kAnn, kStart).at(0);
  const UnitCost large{.bytes = (uint64_t{256} << 20) + 1};
  EXPECT_EQ(scheduler_.units().Complete(kAnn, lease.unit, lease.attempt, kStart, "", large),
            Completion::kAccepted);
  EXPECT_THAT(scheduler_.GrantLeases(kAnn, kStart), IsEmpty());
  EXPECT_FALSE(scheduler_.units().Commit(lease.unit));
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).size(), 1u);
}

TEST_F(SchedulerTest, AJobThatEndsWithFreeUnitsLeavesNothingToOthersLikeIt) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.jobs().Add(kOther, Spec());
  scheduler_.jobs().End(kJob);
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 12u);
  for (const GrantedLease& lease : leases) EXPECT_EQ(lease.unit.job, kOther);
}

TEST_F(SchedulerTest, ARevokedUnitIsLeasedOnceMore) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 12});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_FALSE(scheduler_.units().Revoke(leases[5].unit)) << "it is leased, not committed";
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(10));
  const UnitRef lost = leases[5].unit;
  EXPECT_TRUE(scheduler_.units().Revoke(lost));
  EXPECT_FALSE(scheduler_.units().Revoke(lost));
  EXPECT_THAT(scheduler_.frames().Committed(kJob), IsEmpty());
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, 11);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).samples_done, 16 * 16 * 8 - 8 * 8 * 4);
  const auto again = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(again[0].unit, lost);
  EXPECT_TRUE(Commit(kAnn, again[0]));
  scheduler_.frames().Finish(kJob, 10);
  EXPECT_FALSE(scheduler_.units().Revoke(lost));
}

TEST_F(SchedulerTest, AUnitRevokedBeforeItsTurnIsLeasedOnceMore) {
  scheduler_.jobs().Add(kJob, Spec());
  const UnitRef lost{kJob, {10, 2, 0, v1::UNIT_KIND_GEOMETRY}};
  scheduler_.units().Restore(lost.job, {lost.key}, kStart);
  EXPECT_TRUE(scheduler_.units().Revoke(lost));
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 100});
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).size(), 12u);
}

TEST_F(SchedulerTest, UnknownUnitsAreUnknown) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  for (const UnitRef& unit :
       {UnitRef{kOther, {10, 0, 0, v1::UNIT_KIND_PASS}}, UnitRef{kJob, {11, 0, 0, v1::UNIT_KIND_PASS}},
        UnitRef{kJob, {9, 0, 0, v1::UNIT_KIND_PASS}}, UnitRef{kJob, {10, 4, 0, v1::UNIT_KIND_PASS}},
        UnitRef{kJob, {10, 0, 2, v1::UNIT_KIND_PASS}}}) {
    EXPECT_EQ(scheduler_.units().Complete(kAnn, unit, Attempt(100), kStart), Completion::kUnknown)
        << Describe(unit);
  }
}

TEST_F(SchedulerTest, AJobStaysWithinTheClassOfItsFirstAcceptedUnit) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.workers().Add(kBen, {.numeric_class = "avx512", .slots = 1});
  const GrantedLease first = scheduler_.GrantLeases(kAnn, kStart).at(0);
  const GrantedLease other = scheduler_.GrantLeases(kBen, kStart).at(0);
  EXPECT_EQ(scheduler_.jobs().NumericClassOf(kJob), "");
  EXPECT_EQ(scheduler_.units().Complete(kAnn, first.unit, first.attempt, kStart), Completion::kAccepted);
  EXPECT_EQ(scheduler_.jobs().NumericClassOf(kJob), "avx2");
  EXPECT_EQ(scheduler_.units().Complete(kBen, other.unit, other.attempt, kStart), Completion::kStale);
  EXPECT_THAT(scheduler_.GrantLeases(kBen, kStart), IsEmpty());
  scheduler_.units().Commit(first.unit);
  EXPECT_EQ(scheduler_.GrantLeases(kAnn, kStart).at(0).unit, other.unit);
  scheduler_.jobs().Add(kOther, Spec());
  EXPECT_EQ(scheduler_.GrantLeases(kBen, kStart).at(0).unit.job, kOther);
}

TEST_F(SchedulerTest, AWorkerOfAnotherClassThatLeasesOnceAndDiesDoesNotBlockTheJob) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "sse2", .slots = 1});
  scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_RUNNING);
  scheduler_.workers().Remove(kAnn);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_PLANNED);
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 12});
  for (const GrantedLease& lease : scheduler_.GrantLeases(kBen, kStart)) Commit(kBen, lease);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(10));
}

TEST_F(SchedulerTest, AnEndedJobIsForgottenAndItsSlotsAreFree) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.jobs().Add(kOther, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  scheduler_.units().Complete(kAnn, leases[0].unit, leases[0].attempt, kStart);
  scheduler_.jobs().End(kJob);
  EXPECT_FALSE(scheduler_.jobs().Has(kJob));
  EXPECT_FALSE(scheduler_.units().Commit(leases[0].unit));
  EXPECT_EQ(scheduler_.units().Complete(kAnn, leases[1].unit, leases[1].attempt, kStart),
            Completion::kUnknown);
  const auto next = scheduler_.GrantLeases(kAnn, kStart);
  ASSERT_EQ(next.size(), 2u);
  EXPECT_EQ(next[0].unit.job, kOther);
}

TEST_F(SchedulerTest, StatesFollowTheWork) {
  scheduler_.jobs().Add(kJob, Spec(/*frames=*/2));
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 12});
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_PLANNED);
  for (const int32_t frame : {10, 11}) {
    const auto leases = scheduler_.GrantLeases(kAnn, kStart);
    ASSERT_EQ(leases.size(), 12u);
    EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_RUNNING);
    EXPECT_EQ(scheduler_.jobs().Progress(kJob).workers, 1);
    for (size_t i = 0; i < leases.size(); ++i) {
      EXPECT_EQ(leases[i].unit.key.frame, frame);
      EXPECT_EQ(Commit(kAnn, leases[i]), i + 1 == leases.size());
    }
    EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_FILTERING);
    EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(frame));
    EXPECT_EQ(scheduler_.frames().Finish(kJob, frame), frame == 11);
    EXPECT_THAT(scheduler_.frames().Committed(kJob), IsEmpty());
  }
  const JobProgress progress = scheduler_.jobs().Progress(kJob);
  EXPECT_EQ(progress.state, v1::JOB_STATE_DONE);
  EXPECT_EQ(progress.units_done, progress.units_total);
  EXPECT_EQ(progress.samples_done, 2 * 16 * 16 * 8);
  EXPECT_EQ(progress.samples_done, progress.samples_total);
}

TEST_F(SchedulerTest, RestoredUnitsAreNotRenderedAgain) {
  scheduler_.jobs().Add(kJob, Spec(/*frames=*/3), {.numeric_class = "avx2"});
  EXPECT_TRUE(scheduler_.frames().RestoreFinished(kJob, 10));
  EXPECT_TRUE(scheduler_.units().Restore(kJob, {{10, 1, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_TRUE(scheduler_.units().Restore(kJob, {{11, 0, 0, v1::UNIT_KIND_GEOMETRY}}, kStart));
  EXPECT_TRUE(scheduler_.units().Restore(kJob, {{11, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_TRUE(scheduler_.units().Restore(kJob, {{11, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_FALSE(scheduler_.units().Restore(kJob, {{13, 2, 1, v1::UNIT_KIND_PASS}}, kStart));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, 12 + 2);
  scheduler_.workers().Add(kBen, {.numeric_class = "sse2", .slots = 100});
  EXPECT_THAT(scheduler_.GrantLeases(kBen, kStart), IsEmpty());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kAnn, kStart);
  EXPECT_EQ(leases.size(), 12u - 2 + 12);
  for (const GrantedLease& lease : leases) {
    EXPECT_NE(lease.unit.key, (UnitKey{11, 0, 0, v1::UNIT_KIND_GEOMETRY}));
    EXPECT_NE(lease.unit.key, (UnitKey{11, 2, 1, v1::UNIT_KIND_PASS}));
    EXPECT_NE(lease.unit.key.frame, 10);
  }
}

TEST_F(SchedulerTest, AFrameCommittedBeforeARestartAwaitsItsFinish) {
  scheduler_.jobs().Add(kJob, Spec(), {.numeric_class = "avx2"});
  const FrameUnits units(Spec());
  for (int64_t number = 0; number < units.count(); ++number) {
    scheduler_.units().Restore(kJob, {units.KeyOf(10, number)}, kStart);
  }
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(10));
  EXPECT_TRUE(scheduler_.frames().Finish(kJob, 10));
}

TEST_F(SchedulerTest, AHugeFrameTakesBitsAndNotMegabytesAndGrantsInTime) {
  v1::JobSpec spec = Spec();
  spec.set_width(16384);
  spec.set_height(8192);
  spec.set_tile_size(32);
  spec.set_samples_per_pixel(4096);
  spec.set_pass_samples(64);
  scheduler_.jobs().Add(kJob, spec);
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1000});
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_total, 131072 * 65);
  int64_t committed = 0;
  for (int round = 0; round < 100; ++round) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(kAnn, kStart)) {
      Commit(kAnn, lease);
      ++committed;
    }
  }
  EXPECT_EQ(committed, 100'000);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, committed);
}

TEST_F(SchedulerTest, TagsAndThePinnedClassSayWhoMayRenderAJob) {
  scheduler_.jobs().Add(kJob, Spec(), {.tags = {"night", "gpu"}, .numeric_class = "avx2"});
  scheduler_.workers().Add(WorkerId(1), {.numeric_class = "avx2", .slots = 1, .tags = {"gpu"}});
  scheduler_.workers().Add(WorkerId(2), {.numeric_class = "sse2", .slots = 1, .tags = {"gpu", "night"}});
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.workers().Add(WorkerId(3), {.numeric_class = "avx2", .slots = 1, .tags = {"x", "night", "gpu"}});
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).worker, WorkerId(3));
}

TEST_F(SchedulerTest, APausedJobGetsNoLeasesButKeepsThoseItHas) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kStart);
  scheduler_.jobs().Pause(kJob);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_PAUSED);
  EXPECT_FALSE(Commit(kAnn, leases[0]));
  scheduler_.units().Fail(kAnn, leases[1].unit, leases[1].attempt, {}, kStart);
  scheduler_.ExpireLeases(kStart + absl::Seconds(1));
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  scheduler_.jobs().Resume(kJob);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 2u);
  scheduler_.jobs().Add(kOther, Spec(), {.paused = true});
  EXPECT_EQ(scheduler_.jobs().Progress(kOther).state, v1::JOB_STATE_PAUSED);
}

TEST_F(SchedulerTest, AJobHasNoMoreLeasesThanItsLimit) {
  scheduler_.jobs().Add(kJob, Spec(), {.max_leases = 3});
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 5});
  const auto leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), 3u);
  Commit(kAnn, leases[0]);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
}

TEST_F(SchedulerTest, ADrainedWorkerFinishesWhatItHas) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 2});
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  scheduler_.workers().Drain(kAnn);
  EXPECT_EQ(scheduler_.workers().Describe(kAnn)->state, v1::WORKER_STATE_DRAINING);
  Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_TRUE(scheduler_.workers().Readmit("ann"));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u);
}

TEST_F(SchedulerTest, ABlockedWorkerLosesItsLeasesAndGetsNoneUnderAnyConnection) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 2});
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 2});
  const auto leases = scheduler_.GrantLeases(kStart);
  scheduler_.workers().Block("ann", "wrong pixels");
  const std::vector<RevokedLease> revoked = scheduler_.units().TakeRevoked();
  ASSERT_EQ(revoked.size(), 2u);
  EXPECT_EQ(revoked[0].worker, kAnn);
  EXPECT_EQ(revoked[0].attempt, leases[0].attempt);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, leases[0].unit, leases[0].attempt, kStart), Completion::kStale);
  scheduler_.workers().Remove(kAnn);
  ASSERT_EQ(scheduler_.workers().Blocked().size(), 1u);
  EXPECT_EQ(scheduler_.workers().Blocked()[0].reason, "wrong pixels");
  scheduler_.workers().Add(WorkerId(3), {.name = "ann", .numeric_class = "avx2", .slots = 2});
  EXPECT_EQ(scheduler_.workers().Describe(WorkerId(3))->state, v1::WORKER_STATE_BLOCKED);
  EXPECT_EQ(scheduler_.workers().Describe(WorkerId(3))->reason, "wrong pixels");
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  EXPECT_TRUE(scheduler_.workers().Readmit("ann"));
  EXPECT_FALSE(scheduler_.workers().Readmit("nobody"));
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).unit, leases[0].unit);
}

TEST_F(SchedulerTest, ASkippedFrameIsNeitherLeasedNorCounted) {
  scheduler_.jobs().Add(kJob, Spec(3));
  const int64_t of_frame = scheduler_.jobs().Progress(kJob).units_total / 3;
  for (const int32_t frame : {11, 11, 99}) scheduler_.frames().Skip(kJob, frame);
  EXPECT_TRUE(scheduler_.frames().RestoreFinished(kJob, 10));
  JobProgress progress = scheduler_.jobs().Progress(kJob);
  EXPECT_EQ(progress.frames_skipped, 1);
  EXPECT_EQ(progress.frames_done, 1);
  EXPECT_EQ(progress.frames_total, 3);
  EXPECT_EQ(progress.units_total, 2 * of_frame);
  EXPECT_EQ(progress.samples_total, 2 * 16 * 16 * 8);
  scheduler_.workers().Add(WorkerId(1), {.numeric_class = "avx2", .slots = 100});
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(WorkerId(1), kStart);
  EXPECT_THAT(leases, testing::SizeIs(of_frame));
  for (const GrantedLease& lease : leases) {
    EXPECT_EQ(lease.unit.key.frame, 12);
    Commit(WorkerId(1), lease);
  }
  EXPECT_TRUE(scheduler_.frames().Finish(kJob, 12)) << "it was the last one";
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_DONE);
}

TEST_F(SchedulerTest, AWorkerThatRestsGetsNoLeasesAndKeepsThoseItHas) {
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(WorkerId(1), {.name = "ann", .numeric_class = "avx2", .slots = 2});
  EXPECT_THAT(scheduler_.GrantLeases(WorkerId(1), kStart), testing::SizeIs(2));
  scheduler_.workers().Rest(WorkerId(1), "off hours until 19:00");
  const WorkerInfo info = *scheduler_.workers().Describe(WorkerId(1));
  EXPECT_EQ(info.state, v1::WORKER_STATE_RESTING);
  EXPECT_EQ(info.reason, "off hours until 19:00");
  EXPECT_EQ(info.leases, 2);
  scheduler_.workers().Add(WorkerId(2), {.name = "ben", .numeric_class = "avx2", .slots = 2});
  scheduler_.workers().Drain(WorkerId(2));
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty());
  const std::vector<Reason> reasons = scheduler_.Explain(kJob, kStart);
  ASSERT_FALSE(reasons.empty());
  EXPECT_EQ(reasons[0].code, "worker_unavailable");
  EXPECT_THAT(reasons[0].text, testing::HasSubstr(": ann off hours until 19:00"));
  scheduler_.workers().Drain(WorkerId(1));
  scheduler_.workers().Rest(WorkerId(1), "");
  EXPECT_EQ(scheduler_.workers().Describe(WorkerId(1))->state, v1::WORKER_STATE_DRAINING);
}

TEST_F(SchedulerTest, NoMoreFramesAreActiveThanTheirLimit) {
  scheduler_.frames().SetMaxActive(2);
  scheduler_.jobs().Add(kJob, Spec(/*frames=*/4));
  scheduler_.jobs().Add(kOther, Spec(/*frames=*/2));
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 100});
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 24u);
  EXPECT_EQ(scheduler_.frames().active(), 2);
  for (const GrantedLease& lease : leases) Commit(kAnn, lease);
  EXPECT_THAT(scheduler_.GrantLeases(kStart), IsEmpty()) << "the frames are not written";
  EXPECT_EQ(scheduler_.Explain(leases[0].unit.job, kStart).at(0).code, "frames_in_flight");
  scheduler_.frames().Finish(leases[0].unit.job, leases[0].unit.key.frame);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 12u);
}

TEST_F(SchedulerTest, FramesThatNobodyCanFinishDoNotStopTheOthers) {
  scheduler_.frames().SetMaxActive(1);
  scheduler_.jobs().Add(kJob, Spec());
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 1});
  scheduler_.GrantLeases(kStart);
  scheduler_.jobs().Add(kOther, Spec());
  scheduler_.workers().Add(kBen, {.numeric_class = "avx2", .slots = 12});
  scheduler_.jobs().Pause(kJob);
  EXPECT_EQ(scheduler_.frames().active(), 0);
  EXPECT_EQ(scheduler_.GrantLeases(kStart).at(0).unit.job, kOther) << "a paused job's frame does not count";
  scheduler_.jobs().End(kOther);
  scheduler_.jobs().Resume(kJob);
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) Commit(lease.worker, lease);
  scheduler_.workers().Remove(kAnn);
  scheduler_.workers().Remove(kBen);  // the job is bound to avx2, and its frame is not finished
  scheduler_.jobs().Add(kOther, Spec());
  scheduler_.workers().Add(WorkerId(3), {.numeric_class = "sse2", .slots = 1});
  EXPECT_EQ(scheduler_.GrantLeases(kStart).size(), 1u) << "nor one that no worker can render";
}

std::vector<std::string> Codes(const std::vector<Reason>& reasons) {
  std::vector<std::string> codes;
  codes.reserve(reasons.size());
  for (const Reason& reason : reasons) codes.push_back(reason.code);
  return codes;
}

TEST_F(SchedulerTest, ExplainsWhyAJobDoesNotRun) {
  scheduler_.jobs().Add(kJob, Spec(),
                        {.tags = {"gpu"}, .max_leases = 1, .numeric_class = "avx2", .paused = true});
  auto reasons = scheduler_.Explain(kJob, kStart);
  EXPECT_THAT(Codes(reasons), ElementsAre("paused", "no_worker"));
  EXPECT_THAT(reasons[1].text, HasSubstr("class avx2 with the tags gpu"));
  scheduler_.jobs().Resume(kJob);
  const WorkerTraits traits{.name = "ann", .numeric_class = "avx2", .slots = 1, .tags = {"gpu"}};
  scheduler_.workers().Add(kAnn, traits);
  EXPECT_THAT(scheduler_.Explain(kJob, kStart), IsEmpty());
  scheduler_.workers().Drain(kAnn);
  EXPECT_THAT(Codes(scheduler_.Explain(kJob, kStart)), ElementsAre("worker_unavailable"));
  scheduler_.workers().Readmit("ann");
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  EXPECT_THAT(Codes(scheduler_.Explain(kJob, kStart)), ElementsAre("max_leases"));
  scheduler_.units().Fail(kAnn, lease.unit, lease.attempt, {}, kStart);
  reasons = scheduler_.Explain(kJob, kStart);
  EXPECT_THAT(Codes(reasons), ElementsAre("backoff"));
  EXPECT_THAT(reasons[0].text, HasSubstr("j-1 frame 10 tile 0 geometry, for 1 s"));
  EXPECT_THAT(scheduler_.Explain(JobId("j-none"), kStart), IsEmpty());
}

TEST_F(SchedulerTest, ExplainsThatTheSlotsAreBusyWithOtherJobs) {
  scheduler_.jobs().Add(kJob, Spec(), {.user = "ann"});
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 3});
  scheduler_.GrantLeases(kStart);
  scheduler_.jobs().Add(kOther, Spec(), {.user = "ben"});
  const auto reasons = scheduler_.Explain(kOther, kStart);
  ASSERT_THAT(Codes(reasons), ElementsAre("slots_busy"));
  EXPECT_THAT(reasons[0].text,
              HasSubstr("all 3 slots of the 1 workers that may render the job are busy: it has 0 "
                        "leases, user ann has 3, user ben has 0; the share of its user is 50 %"));
}

TEST_F(SchedulerTest, DescribesWorkersInPages) {
  scheduler_.jobs().Add(kJob, Spec());
  for (int i = 1; i <= 5; ++i) scheduler_.workers().Add(WorkerId(i), {.numeric_class = "avx2", .slots = 1});
  const GrantedLease lease = scheduler_.GrantLeases(kStart).at(0);
  scheduler_.units().Complete(kAnn, lease.unit, lease.attempt, kStart + absl::Seconds(4));
  const auto page = scheduler_.workers().List(WorkerId(0), 2);
  ASSERT_EQ(page.size(), 2u);
  EXPECT_EQ(page[0].traits.name, "w-1");
  EXPECT_EQ(page[0].units_done, 1);
  EXPECT_EQ(page[0].mean_time, absl::Seconds(4));
  EXPECT_THAT(page[1].jobs, ElementsAre(kJob));
  EXPECT_EQ(page[1].state, v1::WORKER_STATE_BUSY);
  EXPECT_EQ(scheduler_.workers().List(WorkerId(4), 10).size(), 1u);
  EXPECT_FALSE(scheduler_.workers().Describe(WorkerId(9)).has_value());
}

TEST_F(SchedulerTest, FramesMayHaveGaps) {
  v1::JobSpec spec = Spec(/*frames=*/1);
  spec.add_more_frames()->set_first(20);
  spec.mutable_more_frames(0)->set_count(2);
  scheduler_.jobs().Add(kJob, spec);
  EXPECT_TRUE(scheduler_.frames().RestoreFinished(kJob, 20));
  EXPECT_FALSE(scheduler_.frames().RestoreFinished(kJob, 11));
  EXPECT_FALSE(scheduler_.units().Restore(kJob, {{19, 0, 0, v1::UNIT_KIND_GEOMETRY}}, kStart));
  scheduler_.workers().Add(kAnn, {.numeric_class = "avx2", .slots = 100});
  std::set<int32_t> frames;
  const auto leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), 24u);
  for (const GrantedLease& lease : leases) {
    frames.insert(lease.unit.key.frame);
    Commit(kAnn, lease);
  }
  EXPECT_EQ(frames, (std::set<int32_t>{10, 21}));
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(10, 21));
  EXPECT_FALSE(scheduler_.frames().Finish(kJob, 21));
  EXPECT_TRUE(scheduler_.frames().Finish(kJob, 10));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).frames_total, 3);
}

}  // namespace
}  // namespace lumifold::scheduler
