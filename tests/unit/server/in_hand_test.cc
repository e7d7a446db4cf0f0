// Units that workers have in hand from connections that broke, and workers that are sent elsewhere.
#include <gmock/gmock.h>

#include "proto/rpc/version.h"
#include "proto/threads/event.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

constexpr uint64_t kProcess = 5;
constexpr int kTiles = 4;
constexpr size_t kUnits = 2 * kTiles;

std::set<job::UnitRef> UnitsOf(const std::vector<v1::Lease>& leases) {
  std::set<job::UnitRef> units;
  for (const v1::Lease& lease : leases) units.insert(job::UnitFromProto(lease.unit()));
  return units;
}

class InHandTest : public CoordinatorFixture {
 protected:
  std::unique_ptr<PumpedWorker> Connect(int slots, const std::vector<v1::Lease>& in_hand = {},
                                        uint64_t instance = kProcess) {
    return std::make_unique<PumpedWorker>(coordinator_.get(), slots, instance, in_hand);
  }
};

TEST_F(InHandTest, AfterARestartTheyAreLeasedToTheWorkerThatHasThemBeforeAllOthers) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTiles));
  std::vector<v1::Lease> in_hand;
  {
    const auto worker = Connect(kUnits);
    in_hand = worker->held();
    ASSERT_THAT(in_hand, SizeIs(kUnits));
  }
  in_hand.erase(in_hand.begin(), in_hand.end() - 3);
  Stop();
  ASSERT_TRUE(Start().ok());
  auto worker = Connect(3, in_hand);
  EXPECT_EQ(worker->leased(), UnitsOf(in_hand));
  EXPECT_GT(worker->held()[0].attempt(), in_hand[2].attempt());
  EXPECT_EQ(Finish(job, worker.get()).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(worker->leased(), SizeIs(kUnits));
  worker.reset();
  Stop();
  EXPECT_THAT(log_.str(), HasSubstr("event=leases_regranted"));
}

TEST_F(InHandTest, AConnectionWhoseEndIsNotNoticedGetsAndHoldsNothingMore) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTiles));
  auto lost = Connect(2);
  const std::vector<v1::Lease> in_hand = lost->held();
  auto worker = Connect(2, in_hand);
  EXPECT_EQ(worker->leased(), UnitsOf(in_hand));
  EXPECT_EQ(lost->Deliver(), 2);  // too late
  EXPECT_THAT(lost->leased(), SizeIs(2));
  EXPECT_EQ(Finish(job, worker.get()).units_done(), static_cast<int64_t>(kUnits));
  lost.reset();
  worker.reset();
  Stop();
  EXPECT_THAT(log_.str(), HasSubstr("event=unit_not_wanted"));
}

TEST_F(InHandTest, AWorkerDropsAtOnceWhatIsNotWanted) {
  ASSERT_TRUE(Start().ok());
  Submit(Spec(kTiles));
  std::vector<v1::Lease> in_hand;
  {
    const auto worker = Connect(3);
    in_hand = worker->held();
    worker->Deliver(1);
    Await([&] { return worker->acknowledged().size() == 1; });
  }
  const auto worker = Connect(3, in_hand);
  EXPECT_EQ(worker->voided(), UnitsOf({in_hand[0]}));
  EXPECT_TRUE(worker->leased().contains(job::UnitFromProto(in_hand[1].unit())));
  EXPECT_FALSE(worker->leased().contains(job::UnitFromProto(in_hand[0].unit())));
}

TEST_F(InHandTest, ThoseOfAJobThatBecomesActiveLaterAreLeasedThen) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTiles));
  std::vector<v1::Lease> in_hand = Connect(kUnits)->held();
  in_hand.erase(in_hand.begin(), in_hand.end() - 2);
  coordinator_->changes().CancelJob(job.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
  Await([&] { return coordinator_->jobs().GetJob(job.value())->state() == v1::JOB_STATE_CANCELLED; });
  const auto worker = Connect(2, in_hand);
  EXPECT_THAT(worker->leased(), IsEmpty());
  EXPECT_THAT(worker->voided(), IsEmpty());
  v1::RetryJobRequest retry;
  retry.set_job_id(job.value());
  threads::Event answered;
  coordinator_->changes().RetryJob(retry, [&answered](const absl::StatusOr<v1::JobStatus>& status) {
    EXPECT_TRUE(status.ok()) << status.status();
    answered.Notify();
  });
  ASSERT_TRUE(answered.WaitFor(absl::Minutes(1)));
  Await([&] { return worker->leases() == 2; });
  EXPECT_EQ(worker->leased(), UnitsOf(in_hand));
}

TEST_F(InHandTest, ConnectionsThatBreakAgainAndAgainAreNobodysFault) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(1));
  std::vector<v1::Lease> in_hand;
  for (int i = 0; i < 10; ++i) {
    const auto worker = Connect(1, in_hand);
    in_hand = worker->held();
    ASSERT_THAT(in_hand, SizeIs(1)) << i;
  }
  auto worker = Connect(1, in_hand);
  EXPECT_EQ(Finish(job, worker.get()).state(), v1::JOB_STATE_DONE);
  worker.reset();
  Stop();
  EXPECT_THAT(log_.str(), Not(HasSubstr("event=unit_in_quarantine")));
}

TEST_F(InHandTest, AHelloWithMoreThanItsSlotsOrWithoutAJobIsRefused) {
  ASSERT_TRUE(Start().ok());
  PumpedWorker sink(coordinator_.get(), 1);
  v1::Hello hello;
  hello.set_numeric_class("test");
  hello.set_slots(1);
  hello.set_wire_version(rpc::kWireVersion);
  hello.add_in_hand()->mutable_unit()->set_job_id("j-1");
  EXPECT_TRUE(coordinator_->workers().AddWorker(hello, access::LocalIdentity(), &sink).ok());
  hello.add_in_hand()->mutable_unit()->set_job_id("j-1");
  EXPECT_TRUE(absl::IsInvalidArgument(
      coordinator_->workers().AddWorker(hello, access::LocalIdentity(), &sink).status()));
  hello.set_slots(2);
  for (const std::string& id : {std::string(), std::string(65, 'j')}) {
    hello.mutable_in_hand(1)->mutable_unit()->set_job_id(id);
    EXPECT_TRUE(absl::IsInvalidArgument(
        coordinator_->workers().AddWorker(hello, access::LocalIdentity(), &sink).status()));
  }
}

TEST_F(InHandTest, MovesThoseThatAreBestSpared) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec(kTiles));
  const auto busiest = Connect(5, {}, 1);
  const auto busy = Connect(3, {}, 2);
  const auto idle = Connect(2, {}, 3);
  ASSERT_EQ(idle->leases(), 0);
  coordinator_->member().MoveWorkers({.workers = 2, .address = "b:7700"});
  EXPECT_EQ(idle->move_address(), "b:7700");
  EXPECT_EQ(busy->move_address(), "b:7700");
  EXPECT_EQ(busiest->move_address(), "");
  coordinator_->member().MoveWorkers({.workers = 0, .address = "c:7700"});
  EXPECT_EQ(idle->move_address(), "b:7700");
  Submit(Spec(kTiles), "another");
  EXPECT_EQ(idle->leases(), 0) << "it gets no more";
  busy->Deliver();
  EXPECT_EQ(busy->leases(), 0);
  Finish(job, busiest.get());
  EXPECT_THAT(busy->acknowledged(), SizeIs(3)) << "what it had is wanted";
}

}  // namespace
}  // namespace lumifold::server
