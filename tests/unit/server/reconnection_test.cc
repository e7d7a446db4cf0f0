// Workers that come back on another connection, and workers that are sent elsewhere.
#include <gmock/gmock.h>

#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;

constexpr int kTilesOfFrame = 4;
constexpr size_t kUnitsOfJob = 2 * kTilesOfFrame;

class ReconnectionTest : public CoordinatorFixture {
 protected:
  std::unique_ptr<PumpedWorker> Connect(int slots, uint64_t instance = 5) {
    return std::make_unique<PumpedWorker>(coordinator_.get(), slots, instance);
  }
};

TEST_F(ReconnectionTest, AConnectionWhoseEndIsNotNoticedGetsAndHoldsNothingMore) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTilesOfFrame));
  auto lost = Connect(2);
  auto worker = Connect(2);
  EXPECT_EQ(worker->leased(), lost->leased());
  EXPECT_EQ(lost->Deliver(), 2);  // too late
  EXPECT_THAT(lost->leased(), SizeIs(2));
  EXPECT_EQ(Finish(job, worker.get()).units_done(), static_cast<int64_t>(kUnitsOfJob));
  EXPECT_THAT(worker->leased(), SizeIs(kUnitsOfJob));
  lost.reset();
  worker.reset();
  Stop();
  EXPECT_THAT(log_.str(), HasSubstr("event=unit_not_wanted"));
}

TEST_F(ReconnectionTest, AUnitThatWasDeliveredIsNotLeasedAgainThoughItsWorkerDoesNotKnow) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTilesOfFrame));
  auto lost = Connect(2);
  const job::UnitRef delivered = lost->next();
  ASSERT_EQ(lost->Deliver(1), 1);  // it may be committed by now, or soon
  const auto worker = Connect(2);
  EXPECT_EQ(Finish(job, worker.get()).units_done(), static_cast<int64_t>(kUnitsOfJob));
  EXPECT_THAT(worker->leased(), SizeIs(kUnitsOfJob - 1));
  EXPECT_FALSE(worker->leased().contains(delivered));
}

TEST_F(ReconnectionTest, ConnectionsThatBreakAgainAndAgainAreNobodysFault) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(1));
  for (int i = 0; i < 10; ++i) ASSERT_EQ(Connect(1)->leases(), 1) << i;
  auto worker = Connect(1);
  EXPECT_EQ(Finish(job, worker.get()).state(), v1::JOB_STATE_DONE);
  worker.reset();
  Stop();
  EXPECT_THAT(log_.str(), Not(HasSubstr("event=unit_in_quarantine")));
}

TEST_F(ReconnectionTest, MovesThoseThatAreBestSpared) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTilesOfFrame));
  const auto busiest = Connect(5, 1);
  const auto busy = Connect(3, 2);
  const auto idle = Connect(2, 3);
  ASSERT_EQ(idle->leases(), 0);
  coordinator_->member().MoveWorkers({.workers = 2, .address = "b:7700"});
  EXPECT_EQ(idle->move_address(), "b:7700");
  EXPECT_EQ(busy->move_address(), "b:7700");
  EXPECT_EQ(busiest->move_address(), "");
  coordinator_->member().MoveWorkers({.workers = 0, .address = "c:7700"});
  EXPECT_EQ(idle->move_address(), "b:7700");
  Submit(Spec(kTilesOfFrame), "another");
  EXPECT_EQ(idle->leases(), 0) << "it gets no more";
  busy->Deliver();
  EXPECT_EQ(busy->leases(), 0);
  Finish(job, busiest.get());
  EXPECT_THAT(busy->acknowledged(), SizeIs(3)) << "what it had is wanted";
}

}  // namespace
}  // namespace lumifold::server
