// Units that two workers render, to find a worker that delivers wrong pixels.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using job::JobId;
using job::UnitRef;
using job::WorkerId;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const WorkerId kCat(3);

class AuditTest : public ::testing::Test {
 protected:
  Scheduler scheduler_{{}};
  absl::Time now_ = kStart;

  void AddWorker(WorkerId id, int slots, const std::string& numeric_class = "avx2") {
    scheduler_.workers().Add(
        id, {.name = absl::StrCat("host-", id.value()), .numeric_class = numeric_class, .slots = slots});
  }
  Completion Complete(const GrantedLease& lease, const std::string& digest) {
    return scheduler_.units().Complete(lease.worker, lease.unit, lease.attempt, now_, digest);
  }
  /// Delivers and commits; the digest is that of the unit.
  void Commit(const GrantedLease& lease, const std::string& salt = "") {
    EXPECT_EQ(Complete(lease, Describe(lease.unit) + salt), Completion::kAccepted);
    scheduler_.units().Commit(lease.unit);
  }
  /// Two units, both of which are audited.
  void AddJobRenderedByAnn() {
    scheduler_.jobs().Add(kJob, RowSpec(1), {.audit_share = 1});
    AddWorker(kAnn, 2);
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Commit(lease);
  }
};

TEST_F(AuditTest, EqualResultsOfTwoWorkersSettleTheAuditAndTheFrame) {
  scheduler_.jobs().Add(kJob, RowSpec(2), {.audit_share = 1});
  AddWorker(kAnn, 4);
  const auto leases = scheduler_.GrantLeases(now_);
  ASSERT_EQ(leases.size(), 4u);
  for (const GrantedLease& lease : leases) Commit(lease);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), IsEmpty());
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty()) << "nobody audits itself";
  AddWorker(kBen, 4);
  const auto audits = scheduler_.GrantLeases(now_);
  ASSERT_EQ(audits.size(), 4u);
  for (const GrantedLease& lease : audits) {
    EXPECT_TRUE(lease.audit);
    EXPECT_EQ(lease.worker, kBen);
    EXPECT_EQ(Complete(lease, Describe(lease.unit)), Completion::kAudited);
    EXPECT_EQ(Complete(lease, Describe(lease.unit)), Completion::kDuplicate);
  }
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
  EXPECT_THAT(scheduler_.frames().TakeSettled(), ElementsAre(std::pair(kJob, 0)));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_settled, 4);
  EXPECT_THAT(scheduler_.workers().TakeFaulty(), IsEmpty());
  EXPECT_TRUE(scheduler_.frames().Finish(kJob, 0));
}

TEST_F(AuditTest, AnAuditThatStandsStillGoesToAnotherWorker) {
  AddJobRenderedByAnn();
  AddWorker(kBen, 2);
  const auto audits = scheduler_.GrantLeases(now_);
  ASSERT_EQ(audits.size(), 2u);
  const HeldLease moves{audits[0].unit, audits[0].attempt, 1};
  const HeldLease hangs{audits[1].unit, audits[1].attempt, 0};
  now_ += absl::Seconds(20);
  scheduler_.workers().Heartbeat(kBen, {moves, hangs}, audits[1].attempt, now_);
  EXPECT_THAT(scheduler_.ExpireLeases(now_), IsEmpty());
  now_ += absl::Seconds(10);
  scheduler_.workers().Heartbeat(kBen, {moves, hangs}, audits[1].attempt, now_);
  const auto late = scheduler_.ExpireLeases(now_);
  ASSERT_EQ(late.size(), 1u);
  EXPECT_EQ(late[0].unit, hangs.unit);
  EXPECT_EQ(late[0].lateness, Lateness::kOverdue);
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty()) << "whoever hangs in it does not get it again";
  AddWorker(kCat, 2);
  const auto again = scheduler_.GrantLeases(now_);
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(again[0].unit, hangs.unit);
  EXPECT_EQ(again[0].worker, kCat);
  EXPECT_TRUE(again[0].audit);
}

TEST_F(AuditTest, TheShareIsChosenByJobAndUnit) {
  std::set<UnitRef> audited[2];
  for (auto& units : audited) {
    Scheduler scheduler({});
    scheduler.jobs().Add(kJob, RowSpec(1000), {.audit_share = 0.25});
    scheduler.workers().Add(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 2000});
    for (const GrantedLease& lease : scheduler.GrantLeases(now_)) {
      scheduler.units().Complete(kAnn, lease.unit, lease.attempt, now_, "same");
      scheduler.units().Commit(lease.unit);
    }
    scheduler.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 2000});
    for (const GrantedLease& lease : scheduler.GrantLeases(now_)) {
      EXPECT_TRUE(lease.audit);
      units.insert(lease.unit);
    }
  }
  EXPECT_NEAR(static_cast<double>(audited[0].size()), 500, 60);
  EXPECT_EQ(audited[0], audited[1]);
}

TEST_F(AuditTest, AThirdWorkerDecidesAndTheFaultyOneLosesAllItsUnits) {
  scheduler_.jobs().Add(kJob, RowSpec(3, /*frames=*/2), {.audit_share = 0.5});
  AddWorker(kAnn, 12);
  const auto leases = scheduler_.GrantLeases(now_);
  ASSERT_EQ(leases.size(), 12u);
  for (const GrantedLease& lease : leases) Commit(lease, "wrong");
  AddWorker(kBen, 12);
  AddWorker(kCat, 12);
  auto audits = scheduler_.GrantLeases(now_);
  ASSERT_THAT(audits, ::testing::Not(IsEmpty()));
  const size_t audited = audits.size();
  EXPECT_EQ(Complete(audits[0], "right"), Completion::kAudited);
  EXPECT_THAT(scheduler_.workers().TakeFaulty(), IsEmpty()) << "one against one";
  const auto third = scheduler_.GrantLeases(now_);
  ASSERT_EQ(third.size(), 1u);
  EXPECT_EQ(third[0].unit, audits[0].unit);
  EXPECT_EQ(third[0].worker, kCat);
  EXPECT_EQ(Complete(third[0], "right"), Completion::kAudited);
  const auto faulty = scheduler_.workers().TakeFaulty();
  ASSERT_EQ(faulty.size(), 1u);
  EXPECT_EQ(faulty[0].name, "host-1");
  EXPECT_THAT(faulty[0].reason, HasSubstr(Describe(third[0].unit)));
  EXPECT_EQ(faulty[0].units.size(), 12u);
  EXPECT_EQ(scheduler_.workers().Describe(kAnn)->state, v1::WORKER_STATE_BLOCKED);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), IsEmpty()) << "until the units are revoked";
  for (const UnitRef& unit : faulty[0].units) EXPECT_TRUE(scheduler_.units().Revoke(unit));
  EXPECT_EQ(scheduler_.units().TakeRevoked().size(), audited - 1) << "audits of revoked units end";
  const auto again = scheduler_.GrantLeases(now_);
  EXPECT_EQ(again.size(), 12u);
  for (const GrantedLease& lease : again) {
    EXPECT_NE(lease.worker, kAnn);
    Commit(lease);
  }
  for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Complete(lease, Describe(lease.unit));
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0, 1));
}

TEST_F(AuditTest, AnAuditorThatIsWrongIsFoundToo) {
  AddJobRenderedByAnn();
  AddWorker(kBen, 1);
  const auto wrong = scheduler_.GrantLeases(now_);
  ASSERT_EQ(wrong.size(), 1u);
  Complete(wrong[0], "wrong");
  AddWorker(kCat, 2);
  for (int i = 0; i < 2; ++i) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Complete(lease, Describe(lease.unit));
  }
  const auto faulty = scheduler_.workers().TakeFaulty();
  ASSERT_EQ(faulty.size(), 1u);
  EXPECT_EQ(faulty[0].name, "host-2");
  EXPECT_THAT(faulty[0].units, IsEmpty());
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
}

TEST_F(AuditTest, AUnitThatIsBeingCommittedWhenItsWorkerIsFoundFaultyIsReportedAfterwards) {
  scheduler_.jobs().Add(kJob, RowSpec(1), {.audit_share = 1});
  AddWorker(kAnn, 2);
  const auto leases = scheduler_.GrantLeases(now_);
  Commit(leases[0], "wrong");
  EXPECT_EQ(Complete(leases[1], "wrong"), Completion::kAccepted);
  AddWorker(kBen, 1);
  AddWorker(kCat, 1);
  for (int i = 0; i < 4; ++i) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Complete(lease, "right");
  }
  auto faulty = scheduler_.workers().TakeFaulty();
  ASSERT_FALSE(faulty.empty());
  EXPECT_THAT(faulty[0].units, ElementsAre(leases[0].unit));
  EXPECT_FALSE(scheduler_.units().Commit(leases[1].unit));
  faulty = scheduler_.workers().TakeFaulty();
  ASSERT_EQ(faulty.size(), 1u);
  EXPECT_THAT(faulty[0].units, ElementsAre(leases[1].unit));
  EXPECT_TRUE(scheduler_.units().Revoke(leases[1].unit));
}

TEST_F(AuditTest, ARestartBeginsTheAuditsOfUnfinishedFramesAgain) {
  scheduler_.jobs().Add(kJob, RowSpec(1), {.numeric_class = "avx2", .audit_share = 1});
  const job::FrameUnits units(RowSpec(1));
  for (int64_t number = 0; number < units.count(); ++number) {
    const job::UnitKey key = units.KeyOf(0, number);
    EXPECT_TRUE(
        scheduler_.units().Restore(kJob, {key, "host-1", Describe(UnitRef{kJob, key}) + "wrong"}, now_));
  }
  EXPECT_THAT(scheduler_.frames().Committed(kJob), IsEmpty());
  AddWorker(kBen, 2);
  AddWorker(kCat, 2);
  for (int i = 0; i < 2; ++i) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) {
      EXPECT_TRUE(lease.audit);
      Complete(lease, Describe(lease.unit));
    }
  }
  const auto faulty = scheduler_.workers().TakeFaulty();
  ASSERT_FALSE(faulty.empty());
  EXPECT_EQ(faulty[0].name, "host-1");
  EXPECT_EQ(faulty[0].units.size(), 2u);
}

TEST_F(AuditTest, ARestoredUnitOfAnUnknownWorkerIsNotAudited) {
  scheduler_.jobs().Add(kJob, RowSpec(1), {.audit_share = 1});
  const job::FrameUnits units(RowSpec(1));
  for (int64_t number = 0; number < units.count(); ++number)
    EXPECT_TRUE(scheduler_.units().Restore(kJob, {units.KeyOf(0, number)}, now_));
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_waived, 2);
}

TEST_F(AuditTest, AResultThatIsWrittenOutlivesTheVerdict) {
  const JobId other("j-other");
  scheduler_.jobs().Add(other, RowSpec(1));
  scheduler_.jobs().Add(kJob, RowSpec(1), {.audit_share = 1});
  AddWorker(kAnn, 4);
  for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Commit(lease, "wrong");
  EXPECT_TRUE(scheduler_.frames().IsCommitted(other, 0));
  AddWorker(kBen, 2);
  AddWorker(kCat, 2);
  for (int i = 0; i < 2; ++i) {
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Complete(lease, Describe(lease.unit));
  }
  ASSERT_FALSE(scheduler_.workers().TakeFaulty().empty());
  EXPECT_FALSE(scheduler_.frames().IsCommitted(other, 0));
  EXPECT_TRUE(scheduler_.frames().Finish(other, 0));
}

TEST_F(AuditTest, AnAuditIsWaivedWhenNoOtherWorkerCanBeFound) {
  AddJobRenderedByAnn();
  scheduler_.workers().Add(WorkerId(9), {.name = "host-1", .numeric_class = "avx2"});  // the same machine
  AddWorker(kBen, 1, "sse2");                                                          // another class
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(30));
  EXPECT_EQ(scheduler_.Explain(kJob, now_).at(0).code, "audit");
  EXPECT_THAT(scheduler_.Explain(kJob, now_).at(0).text,
              HasSubstr("no worker of another name is available, and what nobody compares within 30 s"));
  scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_waived, 2);
  EXPECT_THAT(scheduler_.frames().TakeSettled(), ElementsAre(std::pair(kJob, 0)));
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
}

TEST_F(AuditTest, AnAuditThatAnotherWorkerMayDoWaitsOncePatienceMore) {
  AddJobRenderedByAnn();
  AddWorker(kBen, 2);
  scheduler_.ExpireLeases(kStart + absl::Seconds(30));
  scheduler_.workers().Remove(kBen);
  EXPECT_EQ(scheduler_.NextExpiry(), kStart + absl::Seconds(60));
  scheduler_.ExpireLeases(kStart + absl::Seconds(60) - absl::Nanoseconds(1));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_waived, 0);
  scheduler_.ExpireLeases(kStart + absl::Seconds(60));
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_waived, 2);
}

TEST_F(AuditTest, AnAuditorThatFailsOrLeavesDoesNotEndTheAudit) {
  AddJobRenderedByAnn();
  AddWorker(kBen, 2);
  const auto audits = scheduler_.GrantLeases(now_);
  ASSERT_EQ(audits.size(), 2u);
  EXPECT_TRUE(scheduler_.units().Fail(kBen, audits[0].unit, audits[0].attempt, {.permanent = true}, now_));
  EXPECT_THAT(scheduler_.GrantLeases(now_), IsEmpty()) << "it has declined";
  scheduler_.workers().Remove(kBen);
  AddWorker(kCat, 2);
  const auto again = scheduler_.GrantLeases(now_);
  ASSERT_EQ(again.size(), 2u);
  for (const GrantedLease& lease : again)
    EXPECT_EQ(Complete(lease, Describe(lease.unit)), Completion::kAudited);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
}

TEST_F(AuditTest, FiveWorkersOfWhichNoTwoAgreeGetNobodyBlocked) {
  AddJobRenderedByAnn();
  for (int64_t i = 2; i <= 6; ++i) {
    AddWorker(WorkerId(i), 2);
    for (const GrantedLease& lease : scheduler_.GrantLeases(now_)) Complete(lease, absl::StrCat("mine ", i));
  }
  EXPECT_THAT(scheduler_.workers().TakeFaulty(), IsEmpty());
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).audits_waived, 2);
  EXPECT_THAT(scheduler_.frames().Committed(kJob), ElementsAre(0));
}

}  // namespace
}  // namespace lumifold::scheduler
