#include "server/scheduler/worker_health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/scheduler/unit_names.h"

namespace lumifold::scheduler {
namespace {

using job::WorkerId;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr absl::Duration kCoolDown = absl::Minutes(5);
const WorkerId kCid(3);
const WorkerId kDan(4);

/// Four workers, so that one of them may cool down.
class WorkerHealthTest : public ::testing::Test {
 protected:
  WorkerHealthTest() {
    workers_.Add(kAnn, {.name = "ann", .numeric_class = "avx2"});
    workers_.Add(kBen, {.name = "ben", .numeric_class = "avx2"});
    workers_.Add(kCid, {.name = "cid", .numeric_class = "avx2"});
    workers_.Add(kDan, {.name = "dan", .numeric_class = "avx2"});
  }

  void Attribute(const UnitIndex& unit, WorkerId failed, absl::Time now = kNow) {
    health_.Attribute(failed, unit.job, now);
  }
  bool CoolsDown(WorkerId worker) { return workers_.Find(worker)->IsCooling(); }

  WorkerPool workers_;
  WorkerHealth health_{{.max_attributed_jobs = 2, .cool_down = kCoolDown}, &workers_};
};

TEST_F(WorkerHealthTest, AWorkerThatFailsTwoJobsCoolsDown) {
  Attribute(kFirst, kAnn);
  Attribute(kSecond, kAnn);
  EXPECT_FALSE(CoolsDown(kAnn)) << "one job may be at fault itself";
  Attribute(kOfOther, kAnn);
  EXPECT_TRUE(CoolsDown(kAnn));
  EXPECT_FALSE(CoolsDown(kDan)) << "it rendered the units";
  EXPECT_THAT(health_.CoolDownReason(kAnn), HasSubstr("2 jobs"));
  const std::vector<CoolingWorker> cooling = health_.TakeCooling();
  ASSERT_EQ(cooling.size(), 1u);
  EXPECT_EQ(cooling[0].worker, kAnn);
  EXPECT_EQ(cooling[0].until, kNow + kCoolDown);
  EXPECT_THAT(health_.TakeCooling(), IsEmpty());
}

TEST_F(WorkerHealthTest, FailuresAreForgottenAfterTheCoolDownTime) {
  Attribute(kFirst, kAnn);
  Attribute(kOfOther, kAnn, kNow + kCoolDown);
  EXPECT_FALSE(CoolsDown(kAnn));
  Attribute(kFirst, kAnn, kNow + 2 * kCoolDown - absl::Nanoseconds(1));
  EXPECT_TRUE(CoolsDown(kAnn)) << "the last failures are of two jobs within the time";
}

TEST_F(WorkerHealthTest, ACoolDownEndsAtItsTimeAndWhatCausedItIsForgotten) {
  Attribute(kFirst, kAnn);
  Attribute(kOfOther, kAnn);
  health_.EndCoolDowns(kNow + kCoolDown - absl::Nanoseconds(1));
  EXPECT_TRUE(CoolsDown(kAnn));
  health_.EndCoolDowns(kNow + kCoolDown);
  EXPECT_FALSE(CoolsDown(kAnn));
  EXPECT_EQ(health_.CoolDownReason(kAnn), "");
  Attribute(kFirst, kAnn);
  EXPECT_FALSE(CoolsDown(kAnn)) << "one job since";
}

TEST_F(WorkerHealthTest, HalfOfTheWorkersOfAClassDoNotCoolDown) {
  workers_.Add(WorkerId(9), {.name = "other", .numeric_class = "sse2"});
  for (const WorkerId worker : {kAnn, kBen, kCid}) {
    Attribute(kFirst, worker);
    Attribute(kOfOther, worker);
  }
  EXPECT_TRUE(CoolsDown(kAnn));
  EXPECT_TRUE(CoolsDown(kBen));
  EXPECT_FALSE(CoolsDown(kCid)) << "the third of four";
  for (const WorkerId worker : {kBen, kCid}) workers_.Remove(worker);
  Attribute(kFirst, kDan);
  Attribute(kOfOther, kDan);
  EXPECT_FALSE(CoolsDown(kDan)) << "the last worker that is available";
}

TEST_F(WorkerHealthTest, AWorkerThatIsGoneIsNotAtFault) {
  Attribute(kFirst, kAnn);
  health_.Remove(kAnn);
  workers_.Remove(kAnn);
  Attribute(kOfOther, kAnn);
  EXPECT_THAT(health_.TakeCooling(), IsEmpty());
  EXPECT_EQ(health_.CoolDownReason(kAnn), "");
}

TEST_F(WorkerHealthTest, ABlockIsOfANameAndEndsOneByOne) {
  workers_.Add(WorkerId(9), {.name = "ann", .numeric_class = "avx2"});
  health_.Block("ann", "smoke");
  EXPECT_TRUE(workers_.Find(kAnn)->blocked);
  EXPECT_TRUE(workers_.Find(WorkerId(9))->blocked);
  EXPECT_FALSE(workers_.Find(kBen)->blocked);
  health_.Block("gone", "noise");
  EXPECT_TRUE(health_.IsBlocked("gone"));
  EXPECT_EQ(health_.blocked().at("ann"), "smoke");
  EXPECT_TRUE(health_.Readmit("ann"));
  EXPECT_FALSE(workers_.Find(WorkerId(9))->blocked);
  EXPECT_TRUE(health_.IsBlocked("gone"));
  EXPECT_TRUE(health_.Readmit("gone"));
  EXPECT_FALSE(health_.Readmit("gone")) << "nobody has this name";
}

TEST_F(WorkerHealthTest, AReadmittedWorkerIsNeitherBlockedNorDrainingNorCoolingDown) {
  Attribute(kFirst, kAnn);
  Attribute(kOfOther, kAnn);
  health_.Block("ann", "smoke");
  workers_.Change(kAnn, [](Worker& worker) { worker.draining = true; });
  health_.EndCoolDowns(kNow + kCoolDown);
  EXPECT_FALSE(workers_.IsFree(kAnn)) << "it is still blocked";
  EXPECT_TRUE(health_.Readmit("ann"));
  EXPECT_TRUE(workers_.IsFree(kAnn));
  Attribute(kFirst, kAnn, kNow + kCoolDown);
  EXPECT_FALSE(CoolsDown(kAnn)) << "what was said against it is forgotten";
}

}  // namespace
}  // namespace lumifold::scheduler
