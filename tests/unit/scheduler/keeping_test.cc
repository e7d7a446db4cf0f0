// Frames whose units all go to one worker.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

/// Frames of 4 units: 2 tiles with geometry and a pass.
constexpr int kUnits = 4;

class KeepingTest : public SchedulerFixture {
 protected:
  void AddWorker(WorkerId id, int slots, const KeepOffer& keep = {2, 1000, 50}) {
    scheduler_.workers().Add(
        id,
        {.name = absl::StrCat("host-", id.value()), .numeric_class = "avx2", .slots = slots, .keep = keep});
  }
  void AddJob(int frames) {
    scheduler_.jobs().Add(kJob, RowSpec(2, frames), {.numeric_class = "avx2"});
    scheduler_.keeping().SetDemand(kJob, {.record_bytes = 100, .finish_bytes = 50});
  }
  std::set<int32_t> FramesOf(const std::vector<GrantedLease>& leases, WorkerId worker) {
    std::set<int32_t> frames;
    for (const GrantedLease& lease : leases) {
      if (lease.worker == worker) frames.insert(lease.unit.key.frame);
    }
    return frames;
  }
};

TEST_F(KeepingTest, AllUnitsOfAFrameGoToTheWorkerThatBeginsIt) {
  AddJob(20);
  AddWorker(kAnn, 1);
  AddWorker(kBen, 1);
  for (int i = 0; i < kUnits; ++i) {
    const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
    ASSERT_EQ(leases.size(), 2u);
    EXPECT_THAT(FramesOf(leases, kAnn), ElementsAre(0));
    EXPECT_THAT(FramesOf(leases, kBen), ElementsAre(1));
    for (const GrantedLease& lease : leases) {
      EXPECT_TRUE(lease.keep);
      EXPECT_EQ(Commit(lease.worker, lease), i == kUnits - 1);
    }
  }
  EXPECT_EQ(scheduler_.keeping().KeeperOf(kJob, 0), kAnn);
  EXPECT_EQ(scheduler_.keeping().KeeperOf(kJob, 1), kBen);
  EXPECT_THAT(FramesOf(scheduler_.GrantLeases(kStart), kAnn), ElementsAre(2)) << "before 0 is finished";
  EXPECT_EQ(scheduler_.keeping().CountOf(kJob), 4);
  scheduler_.keeping().End(kJob, 0);
  EXPECT_EQ(scheduler_.keeping().KeeperOf(kJob, 0), std::nullopt);
  EXPECT_FALSE(scheduler_.frames().Finish(kJob, 0)) << "not the last one";
}

TEST_F(KeepingTest, TheLastFramesAreSharedByAll) {
  AddJob(5);
  AddWorker(kAnn, 2 * kUnits);
  AddWorker(kBen, 1);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  for (const GrantedLease& lease : leases) EXPECT_EQ(lease.keep, lease.unit.key.frame < 2);
  EXPECT_THAT(FramesOf(leases, kAnn), ElementsAre(0, 1)) << "4 and 3 others for two workers";
  EXPECT_THAT(FramesOf(leases, kBen), ElementsAre(2));
}

TEST_F(KeepingTest, NoMoreThanTheWorkerOffers) {
  AddJob(40);
  AddWorker(kAnn, 4 * kUnits, {.frames = 9, .record_bytes = 299, .finish_bytes = 50});
  std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  for (const GrantedLease& lease : leases) EXPECT_EQ(lease.keep, lease.unit.key.frame < 2) << "by memory";
  AddWorker(kBen, kUnits, {.frames = 9, .record_bytes = 299, .finish_bytes = 49});
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) EXPECT_FALSE(lease.keep);
  AddWorker(WorkerId(3), 4 * kUnits, {.frames = 1, .record_bytes = 999, .finish_bytes = 50});
  leases = scheduler_.GrantLeases(kStart);
  ASSERT_EQ(leases.size(), size_t{kUnits}) << "by number: it waits";
  for (const GrantedLease& lease : leases) EXPECT_TRUE(lease.keep);
  scheduler_.keeping().SetDemand(kJob, {.record_bytes = 100, .finish_bytes = 50, .least_in_flight = 5});
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) EXPECT_FALSE(lease.keep);
  EXPECT_EQ(scheduler_.frames().active(), 5) << "so many travel";
}

TEST_F(KeepingTest, KeptFramesAreNotInFlight) {
  AddJob(40);
  AddWorker(kAnn, 3 * kUnits);
  AddWorker(kBen, 3 * kUnits, {});
  scheduler_.frames().SetMaxActive(1);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  EXPECT_THAT(FramesOf(leases, kAnn), ElementsAre(0, 1));
  EXPECT_THAT(FramesOf(leases, kBen), ElementsAre(2)) << "the limit";
  EXPECT_EQ(scheduler_.frames().active(), 1);
  scheduler_.jobs().Pause(kJob);
  EXPECT_EQ(scheduler_.frames().active(), 0);
  scheduler_.jobs().Resume(kJob);
  EXPECT_EQ(scheduler_.frames().active(), 1);
  scheduler_.keeping().Stop(kJob, 0);
  EXPECT_EQ(scheduler_.frames().active(), 2);
  scheduler_.jobs().End(kJob);
  EXPECT_EQ(scheduler_.frames().active(), 0);
}

TEST_F(KeepingTest, AUnitThatComesBackEndsIt) {
  AddJob(20);
  AddWorker(kAnn, 2);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  Commit(kAnn, leases[0]);
  EXPECT_THAT(scheduler_.keeping().TakeBroken(), IsEmpty());
  ASSERT_TRUE(scheduler_.units().HandBack(kAnn, leases[1].unit, leases[1].attempt));
  EXPECT_THAT(scheduler_.keeping().TakeBroken(), ElementsAre(Pair(kJob, 0)));
  scheduler_.keeping().Stop(kJob, 0);
  EXPECT_TRUE(scheduler_.units().Revoke(leases[0].unit));
  AddWorker(kBen, kUnits);
  std::set<job::UnitRef> granted;
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) {
    if (lease.unit.key.frame == 0) granted.insert(lease.unit);
    EXPECT_EQ(lease.keep, lease.unit.key.frame != 0);
  }
  EXPECT_EQ(granted.size(), size_t{kUnits}) << "all of them, to anybody";
}

TEST_F(KeepingTest, AFailedUnitDoesToo) {
  AddJob(20);
  AddWorker(kAnn, 1);
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  ASSERT_TRUE(scheduler_.units().Fail(kAnn, leases[0].unit, leases[0].attempt, {.error = "no"}, kStart));
  EXPECT_THAT(scheduler_.keeping().TakeBroken(), ElementsAre(Pair(kJob, 0)));
}

TEST_F(KeepingTest, AWorkerThatIsAvailableNoLongerKeepsNothing) {
  AddJob(60);
  for (const bool rests : {false, true}) {
    AddWorker(kAnn, 1);
    const int32_t frame = scheduler_.GrantLeases(kStart)[0].unit.key.frame;
    if (rests) scheduler_.workers().Rest(kAnn, "off hours");
    if (!rests) scheduler_.workers().Remove(kAnn);
    EXPECT_THAT(scheduler_.keeping().TakeBroken(), ElementsAre(Pair(kJob, frame))) << rests;
    scheduler_.keeping().Stop(kJob, frame);
    EXPECT_EQ(scheduler_.units().TakeRevoked().size(), rests ? 1u : 0u);
    scheduler_.workers().Remove(kAnn);
    // Somebody else renders it, and keeps nothing of it.
    AddWorker(kBen, kUnits, {});
    for (const GrantedLease& lease : scheduler_.GrantLeases(kStart)) {
      EXPECT_EQ(lease.unit.key.frame, frame);
      EXPECT_FALSE(lease.keep);
      Commit(kBen, lease);
    }
    EXPECT_TRUE(scheduler_.frames().IsCommitted(kJob, frame));
    scheduler_.workers().Remove(kBen);
  }
}

TEST_F(KeepingTest, AfterARestartFramesThatHaveBegunDoNotWaitForThoseThatWereKept) {
  AddJob(20);
  ASSERT_TRUE(scheduler_.units().Restore(kJob, {{3, 0, 0, v1::UNIT_KIND_PASS}}, kStart));
  scheduler_.frames().SetMaxActive(1);
  AddWorker(kAnn, 2 * kUnits, {});
  const std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  EXPECT_EQ(leases.size(), size_t{kUnits} - 1);
  EXPECT_THAT(FramesOf(leases, kAnn), ElementsAre(3));
}

TEST_F(KeepingTest, NobodyElseGetsALateUnit) {
  AddJob(3);
  AddWorker(kAnn, 2, {.frames = 1, .record_bytes = 1000, .finish_bytes = 50});
  std::vector<GrantedLease> leases = scheduler_.GrantLeases(kStart);
  ASSERT_TRUE(leases[1].keep);
  Commit(kAnn, leases[0]);
  scheduler_.jobs().Pause(kJob);
  scheduler_.jobs().Resume(kJob);
  AddWorker(kBen, 40, {});
  for (const GrantedLease& lease : scheduler_.GrantLeases(kStart + absl::Seconds(9)))
    EXPECT_EQ(lease.worker == kBen, lease.unit.key.frame > 0);
}

}  // namespace
}  // namespace lumifold::scheduler
