#include "server/scheduler/quarantine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

class QuarantineTest : public ::testing::Test {
 protected:
  QuarantineTest() {
    workers_.Add(kAnn, {.name = "ann", .party = "ann", .numeric_class = "avx2", .slots = 2});
    workers_.Add(kBen, {.name = "ben", .party = "ben", .numeric_class = "avx2", .slots = 2});
  }

  void MakeSuspect(const UnitIndex& unit) {
    for (const char* worker : {"x", "y", "z"}) quarantine_.AddLoss(unit, worker);
  }
  void Reserve(const Requirement* requirement = &kAvx2) {
    quarantine_.Reserve(
        [requirement](const UnitIndex&) { return requirement; },
        [this](const Worker& worker, const UnitIndex&) { return worker.traits.party != excluded_; });
  }

  std::string excluded_;  // party
  WorkerPool workers_;
  Quarantine quarantine_{3, &workers_};
};

TEST_F(QuarantineTest, AUnitIsSuspectFromTheThirdWorkerOrTheSixthLossOn) {
  quarantine_.AddLoss(kFirst, "x");
  quarantine_.AddLoss(kFirst, "y");
  quarantine_.AddLoss(kSecond, "z");
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst));
  for (int i = 0; i < 3; ++i) quarantine_.AddLoss(kFirst, "y");
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst)) << "five losses of two workers";
  quarantine_.AddLoss(kFirst, "x");
  EXPECT_TRUE(quarantine_.IsSuspect(kFirst));
  EXPECT_FALSE(quarantine_.IsSuspect(kSecond));
  quarantine_.AddLoss(kSecond, "x");
  quarantine_.AddLoss(kSecond, "y");
  EXPECT_TRUE(quarantine_.IsSuspect(kSecond)) << "three workers";
}

TEST_F(QuarantineTest, AnAcceptedUnitIsNoSuspectAnyMore) {
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  quarantine_.Forget(kFirst);
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst));
  EXPECT_THAT(quarantine_.waiting(), IsEmpty());
  quarantine_.AddLoss(kFirst, "x");
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst)) << "losses are counted from the beginning";
}

TEST_F(QuarantineTest, TheUnitIsReadyWhenItsWorkerHasNothingElse) {
  workers_.TakeSlot(kAnn);
  workers_.TakeSlot(kBen);
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  Reserve();
  EXPECT_THAT(quarantine_.waiting(), IsEmpty());
  EXPECT_FALSE(workers_.IsFree(kAnn)) << "it gets no other leases";
  EXPECT_TRUE(workers_.IsFree(kBen));
  EXPECT_THAT(quarantine_.TakeReady(), IsEmpty());
  workers_.ReleaseSlot(kAnn);
  quarantine_.EndIfIdle(kAnn);
  EXPECT_FALSE(workers_.IsFree(kAnn)) << "its unit is not leased yet";
  EXPECT_THAT(quarantine_.TakeReady(), ElementsAre(Pair(kAnn, kFirst)));
  EXPECT_THAT(quarantine_.TakeReady(), IsEmpty()) << "once";
  workers_.TakeSlot(kAnn);
  quarantine_.EndIfIdle(kAnn);
  EXPECT_FALSE(workers_.IsFree(kAnn));
  workers_.ReleaseSlot(kAnn);
  quarantine_.EndIfIdle(kAnn);
  EXPECT_TRUE(workers_.IsFree(kAnn));
}

TEST_F(QuarantineTest, AWorkerThatWasNotLostWithTheUnitComesFirstThenAnIdleOne) {
  MakeSuspect(kFirst);
  quarantine_.AddLoss(kFirst, "ann");
  workers_.TakeSlot(kBen);
  quarantine_.Enter(kFirst);
  Reserve();
  EXPECT_FALSE(workers_.IsFree(kBen)) << "busy, but not lost with the unit";
  EXPECT_TRUE(workers_.IsFree(kAnn));
  MakeSuspect(kSecond);
  workers_.TakeSlot(kAnn);
  workers_.Add(WorkerId(3), {.name = "cid", .party = "cid", .numeric_class = "avx2", .slots = 2});
  quarantine_.Enter(kSecond);
  Reserve();
  EXPECT_THAT(quarantine_.TakeReady(), ElementsAre(Pair(WorkerId(3), kSecond)));
}

TEST_F(QuarantineTest, NoWorkerIsReservedForAPausedJobOrOneThatItMayNotRender) {
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  Reserve(nullptr);
  const Requirement sse2{"sse2", {}};
  Reserve(&sse2);
  EXPECT_THAT(quarantine_.waiting(), ElementsAre(kFirst));
  EXPECT_TRUE(workers_.IsFree(kAnn));
  EXPECT_TRUE(workers_.IsFree(kBen));
}

TEST_F(QuarantineTest, TheLastWorkerIsNotReservedWhileItCoolsDown) {
  workers_.Remove(kBen);
  workers_.Change(kAnn, [](Worker& worker) { worker.cools_until = absl::FromUnixSeconds(1); });
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  Reserve();
  EXPECT_THAT(quarantine_.waiting(), ElementsAre(kFirst));
  workers_.Change(kAnn, [](Worker& worker) { worker.cools_until = absl::InfinitePast(); });
  Reserve();
  EXPECT_THAT(quarantine_.TakeReady(), ElementsAre(Pair(kAnn, kFirst)));
}

TEST_F(QuarantineTest, ACancelledReservationLetsTheUnitWaitAgain) {
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  Reserve();
  quarantine_.Cancel(kBen);  // has none
  EXPECT_THAT(quarantine_.waiting(), IsEmpty());
  quarantine_.Cancel(kAnn);
  EXPECT_THAT(quarantine_.waiting(), ElementsAre(kFirst));
  EXPECT_TRUE(workers_.IsFree(kAnn));
  Reserve();
  ASSERT_THAT(quarantine_.TakeReady(), ElementsAre(Pair(kAnn, kFirst)));
  quarantine_.Cancel(kAnn);
  EXPECT_THAT(quarantine_.waiting(), IsEmpty()) << "the unit is leased";
  EXPECT_FALSE(workers_.IsFree(kAnn));
}

TEST_F(QuarantineTest, AtMostSixteenWorkersAreReserved) {
  for (int i = 3; i <= 20; ++i)
    workers_.Add(WorkerId(i),
                 {.name = absl::StrCat("w", i), .party = absl::StrCat("w", i), .numeric_class = "avx2"});
  for (int i = 0; i < 18; ++i) quarantine_.Enter({7, {0, i}});
  Reserve();
  EXPECT_EQ(quarantine_.TakeReady().size(), 16u);
  EXPECT_EQ(quarantine_.waiting().size(), 2u);
}

TEST_F(QuarantineTest, AProcessThatIsHereAgainTakesItsOwnLossesBack) {
  for (const char* party : {"x", "y", "ann"}) quarantine_.AddLoss(kFirst, party);
  quarantine_.NoteAbsence(42, kFirst);
  quarantine_.NoteAbsence(0, kFirst);  // not known
  quarantine_.Enter(kFirst);
  EXPECT_THAT(quarantine_.TakeBackLosses(43, "ann"), IsEmpty()) << "another process";
  EXPECT_THAT(quarantine_.TakeBackLosses(0, "ann"), IsEmpty());
  EXPECT_FALSE(quarantine_.Release(kFirst));
  EXPECT_THAT(quarantine_.TakeBackLosses(42, "ann"), ElementsAre(kFirst));
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst));
  EXPECT_TRUE(quarantine_.Release(kFirst));
  EXPECT_FALSE(quarantine_.Release(kFirst)) << "once";
  EXPECT_THAT(quarantine_.LossesOf(kFirst), ElementsAre("x", "y"));
  EXPECT_THAT(quarantine_.TakeBackLosses(42, "x"), IsEmpty()) << "once";
}

TEST_F(QuarantineTest, AUnitThatIsStillSuspectStaysWhenAProcessIsHereAgain) {
  MakeSuspect(kFirst);
  quarantine_.AddLoss(kFirst, "ann");
  quarantine_.NoteAbsence(42, kFirst);
  quarantine_.Enter(kFirst);
  quarantine_.TakeBackLosses(42, "ann");
  EXPECT_FALSE(quarantine_.Release(kFirst));
  EXPECT_THAT(quarantine_.waiting(), ElementsAre(kFirst));
}

TEST_F(QuarantineTest, AWorkerThatMayNotRenderTheJobIsNotReserved) {
  excluded_ = "ann";
  workers_.TakeSlot(kBen);
  MakeSuspect(kFirst);
  quarantine_.Enter(kFirst);
  Reserve();
  EXPECT_TRUE(workers_.IsFree(kAnn));
  EXPECT_FALSE(workers_.IsFree(kBen));
}

TEST_F(QuarantineTest, AJobThatEndsLeavesTheUnitsOfOthers) {
  MakeSuspect(kFirst);
  MakeSuspect(kSecond);
  MakeSuspect(kOfOther);
  quarantine_.Enter(kFirst);
  Reserve();
  quarantine_.Enter(kSecond);
  quarantine_.Enter(kOfOther);
  quarantine_.EndJob(7);
  EXPECT_THAT(quarantine_.waiting(), ElementsAre(kOfOther));
  EXPECT_TRUE(workers_.IsFree(kAnn)) << "reserved for a unit of the job";
  EXPECT_FALSE(quarantine_.IsSuspect(kFirst));
  EXPECT_TRUE(quarantine_.IsSuspect(kOfOther));
}

}  // namespace
}  // namespace lumifold::scheduler
