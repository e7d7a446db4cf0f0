// The plan unit: the only unit of a job until it is planned.
#include "tests/support/made_up_plan.h"
#include "tests/unit/scheduler/scheduler_fixture.h"

namespace lumifold::scheduler {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::IsEmpty;
using ::testing::SizeIs;

v1::JobSpec Unplanned(int frames = 2) {
  v1::JobSpec spec = Spec(frames);
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_AUTO);
  return spec;
}

/// 4 tiles x (1 + 2) units a frame, as Spec.
v1::JobSpec Planned(int frames = 2, const std::vector<int32_t>& tile_order = {}) {
  v1::JobSpec spec = Unplanned(frames);
  *spec.mutable_plan() = MadeUpPlan(8, 4, tile_order);
  return spec;
}

class PlanUnitTest : public SchedulerFixture {
 protected:
  void SetUp() override {
    scheduler_.jobs().Add(kJob, Unplanned());
    scheduler_.workers().Add(kAnn, {.name = "ann", .numeric_class = "avx2", .slots = 4});
  }

  std::vector<GrantedLease> Grant(absl::Time now = kStart) { return scheduler_.GrantLeases(now); }

  /// Leases the plan unit and delivers it.
  job::UnitRef AcceptPlan() {
    const std::vector<GrantedLease> leases = Grant();
    EXPECT_THAT(leases, SizeIs(1));
    EXPECT_EQ(scheduler_.units().Complete(leases[0].worker, leases[0].unit, leases[0].attempt, kStart),
              Completion::kAccepted);
    return leases[0].unit;
  }
};

TEST_F(PlanUnitTest, IsTheOnlyUnitOfAJobWithoutAPlan) {
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).state, v1::JOB_STATE_SUBMITTED);
  const std::vector<GrantedLease> leases = Grant();
  ASSERT_THAT(leases, SizeIs(1));
  EXPECT_EQ(leases[0].unit.key, (job::UnitKey{10, 0, 0, v1::UNIT_KIND_PLAN}));
  EXPECT_EQ(leases[0].rect, (Rect{0, 0, 16, 16}));
  EXPECT_EQ(leases[0].samples.blocks()[0].count(), 0);
  const JobProgress progress = scheduler_.jobs().Progress(kJob);
  EXPECT_EQ(progress.state, v1::JOB_STATE_RUNNING);
  EXPECT_EQ(progress.units_total, 1);
  EXPECT_EQ(progress.frames_total, 2);
  EXPECT_EQ(progress.samples_total, 2 * 16 * 16 * 8);
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 4});
  EXPECT_THAT(Grant(), IsEmpty());
}

TEST_F(PlanUnitTest, ThePlanDividesTheJobIntoTheUnitsOfItsFrames) {
  const job::UnitRef unit = AcceptPlan();
  EXPECT_THAT(Grant(), IsEmpty()) << "not before the plan is committed";
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_total, 2 * 12);
  EXPECT_EQ(scheduler_.jobs().Progress(kJob).units_done, 0);
  EXPECT_EQ(scheduler_.frames().in_flight(), 0);
  int finished = 0;
  for (int round = 0; round < 100 && finished < 2; ++round) {
    for (const GrantedLease& lease : Grant()) {
      if (Commit(lease.worker, lease))
        finished += scheduler_.frames().Finish(kJob, lease.unit.key.frame) ? 2 : 0;
    }
  }
  EXPECT_EQ(finished, 2) << "the last frame ends the job";
}

TEST_F(PlanUnitTest, BindsTheJobToTheClassOfItsWorker) {
  const job::UnitRef unit = AcceptPlan();
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_EQ(scheduler_.jobs().NumericClassOf(kJob), "avx2");
  scheduler_.workers().Remove(kAnn);
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "neon", .slots = 4});
  EXPECT_THAT(Grant(), IsEmpty());
}

TEST_F(PlanUnitTest, IsLeasedAgainWhenItsWorkerIsLost) {
  ASSERT_THAT(Grant(), SizeIs(1));
  scheduler_.workers().Remove(kAnn);
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "neon", .slots = 4});
  const job::UnitRef unit = AcceptPlan();
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_EQ(scheduler_.jobs().NumericClassOf(kJob), "neon");
  EXPECT_THAT(Grant(), SizeIs(4)) << "the slots of ben";
}

TEST_F(PlanUnitTest, IsLeasedAgainWhenItsLeaseExpires) {
  const std::vector<GrantedLease> first = Grant();
  const absl::Time late = kStart + absl::Seconds(31);
  ASSERT_THAT(scheduler_.ExpireLeases(late), SizeIs(1));
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 1});
  const std::vector<GrantedLease> second = Grant(late);
  ASSERT_THAT(second, SizeIs(1));
  EXPECT_EQ(second[0].unit, first[0].unit);
  EXPECT_EQ(scheduler_.units().Complete(kAnn, first[0].unit, first[0].attempt, late), Completion::kStale);
  EXPECT_EQ(scheduler_.units().Complete(kBen, second[0].unit, second[0].attempt, late),
            Completion::kAccepted);
}

TEST_F(PlanUnitTest, AFailureIsThatOfAnyUnit) {
  std::vector<GrantedLease> leases = Grant();
  scheduler_.units().Fail(kAnn, leases[0].unit, leases[0].attempt, {}, kStart);
  const absl::Time later = kStart + absl::Seconds(2);
  scheduler_.ExpireLeases(later);
  leases = Grant(later);
  ASSERT_THAT(leases, SizeIs(1));
  scheduler_.units().Fail(kAnn, leases[0].unit, leases[0].attempt, {.permanent = true}, later);
  EXPECT_THAT(Grant(later), IsEmpty());
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2"});
  EXPECT_THAT(Grant(later), SizeIs(1)) << "another worker is asked";
}

TEST_F(PlanUnitTest, OneThatStandsStillIsLeasedToAnotherWorkerToo) {
  const GrantedLease held = Grant().at(0);
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2"});
  const HeldLease still{.unit = held.unit, .attempt = held.attempt};
  absl::Time now = kStart;
  for (int i = 0; i < 6; ++i, now += absl::Seconds(5)) {
    EXPECT_THAT(Grant(now), IsEmpty()) << now - kStart;
    scheduler_.workers().Heartbeat(kAnn, {still}, held.attempt, now);
  }
  scheduler_.ExpireLeases(now);
  EXPECT_THAT(scheduler_.Explain(kJob, now), Contains(Field(&Reason::code, "no_progress")));
  const std::vector<GrantedLease> second = Grant(now);
  ASSERT_THAT(second, SizeIs(1));
  EXPECT_EQ(second[0].worker, kBen);
  EXPECT_EQ(second[0].unit, held.unit);
}

TEST_F(PlanUnitTest, IsNotAudited) {
  scheduler_.jobs().Add(kOther, Unplanned(), {.audit_share = 1});
  scheduler_.jobs().End(kJob);
  const job::UnitRef unit = AcceptPlan();
  scheduler_.workers().Add(kBen, {.name = "ben", .numeric_class = "avx2", .slots = 4});
  EXPECT_THAT(Grant(), IsEmpty());
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_EQ(scheduler_.jobs().Progress(kOther).audits_waived, 0);
  EXPECT_THAT(Grant(), SizeIs(8));
}

/// Tiles of the leases, in their order.
std::vector<int32_t> TilesOf(const std::vector<GrantedLease>& leases) {
  std::vector<int32_t> tiles;
  tiles.reserve(leases.size());
  for (const GrantedLease& lease : leases) tiles.push_back(lease.unit.key.tile);
  return tiles;
}

TEST_F(PlanUnitTest, TilesAreLeasedInThePlansOrder) {
  const job::UnitRef unit = AcceptPlan();
  scheduler_.units().SetPlan(unit, Planned(2, {2, 0, 3, 1}));
  for (int grant = 0; grant < 6; ++grant) {  // geometry and passes of both frames
    const std::vector<GrantedLease> leases = Grant();
    switch (grant % 3) {
      case 0:  // what is seen early goes from the middle outwards
        EXPECT_THAT(TilesOf(leases), ElementsAre(0, 0, 1, 1));
        break;
      case 1:
        EXPECT_THAT(TilesOf(leases), ElementsAre(3, 3, 2, 2));
        break;
      default:
        EXPECT_THAT(TilesOf(leases), ElementsAre(2, 0, 3, 1));
    }
    for (const GrantedLease& lease : leases) Commit(lease.worker, lease);
  }
}

TEST_F(PlanUnitTest, ARestartGoesOnInThePlansOrder) {
  scheduler_.jobs().End(kJob);
  scheduler_.jobs().Add(kOther, Planned(1, {2, 0, 3, 1}), {.numeric_class = "avx2"});
  const auto restore = [this](int32_t tile, int32_t pass, v1::UnitKind kind) {
    EXPECT_TRUE(scheduler_.units().Restore(kOther, {.key = {10, tile, pass, kind}}, kStart));
  };
  for (const int32_t tile : {0, 1, 2, 3}) {
    restore(tile, 0, v1::UNIT_KIND_GEOMETRY);
    restore(tile, 0, v1::UNIT_KIND_PASS);
  }
  restore(0, 1, v1::UNIT_KIND_PASS);
  EXPECT_THAT(TilesOf(Grant()), ElementsAre(2, 3, 1));
}

TEST_F(PlanUnitTest, APausedJobIsPlannedButNotDivided) {
  const job::UnitRef unit = AcceptPlan();
  scheduler_.jobs().Pause(kJob);
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_THAT(Grant(), IsEmpty());
  EXPECT_EQ(scheduler_.frames().active(), 0);
  scheduler_.jobs().Resume(kJob);
  EXPECT_THAT(Grant(), SizeIs(4));
}

TEST_F(PlanUnitTest, APlanOfAJobThatHasEndedChangesNothing) {
  const job::UnitRef unit = AcceptPlan();
  scheduler_.jobs().End(kJob);
  scheduler_.units().SetPlan(unit, Planned());
  EXPECT_FALSE(scheduler_.jobs().Has(kJob));
}

TEST_F(PlanUnitTest, ARestartAfterThePlanGoesOnWithIt) {
  scheduler_.jobs().End(kJob);
  scheduler_.jobs().Add(kOther, Planned(1), {.numeric_class = "avx2"});
  EXPECT_EQ(scheduler_.jobs().Progress(kOther).state, v1::JOB_STATE_PLANNED);
  EXPECT_FALSE(scheduler_.units().Restore(kOther, {.key = {10, 0, 0, v1::UNIT_KIND_PLAN}}, kStart));
  EXPECT_TRUE(scheduler_.units().Restore(kOther, {.key = {10, 3, 0, v1::UNIT_KIND_GEOMETRY}}, kStart));
  EXPECT_EQ(scheduler_.jobs().Progress(kOther).units_done, 1);
}

}  // namespace
}  // namespace lumifold::scheduler
