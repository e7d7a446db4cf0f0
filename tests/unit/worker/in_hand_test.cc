// Units that a worker has in hand when its connection breaks.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <functional>
#include <sstream>
#include <string>
#include <thread>

#include "tests/unit/worker/worker_rig.h"

namespace lumifold::worker {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

/// A worker of one thread whose log can be read once it has ended.
class InHandTest : public ::testing::Test {
 protected:
  InHandTest() {
    log_->set_level(spdlog::level::debug);
    rig_ = std::make_unique<Rig>(std::string(kScene), Spec(), 1, WorkerLog{.log = log_});
  }

  /// Loses the connection and opens another one.
  std::shared_ptr<FakeOutbox> Reconnect() {
    rig_->worker->OnDisconnected();
    auto next = std::make_shared<FakeOutbox>();
    rig_->worker->OnConnected(next);
    return next;
  }
  /// Number of lines of the log with this event; the worker ends.
  int Count(const std::string& event) {
    rig_ = nullptr;
    int count = 0;
    std::istringstream lines(text_.str());
    for (std::string line; std::getline(lines, line);)
      count += line.find("event=" + event + " ") != std::string::npos ? 1 : 0;
    return count;
  }
  static v1::CoordinatorMessage GrantAgain(v1::CoordinatorMessage grant, int64_t first_attempt = 100) {
    for (v1::Lease& lease : *grant.mutable_grant()->mutable_leases()) lease.set_attempt(first_attempt++);
    return grant;
  }

  std::ostringstream text_;
  const std::shared_ptr<spdlog::logger> log_ =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_));
  std::unique_ptr<Rig> rig_;
};

TEST_F(InHandTest, ARenderedUnitIsDeliveredForItsNextLeaseWithoutBeingRenderedAgain) {
  const v1::CoordinatorMessage grant = Grant(1);
  rig_->worker->OnMessage(grant);
  const std::string pixels = rig_->outbox->Await(1)[0].chunk().pixels().SerializeAsString();
  const auto next = Reconnect();
  const std::vector<v1::Lease> in_hand = rig_->worker->InHand();
  ASSERT_THAT(in_hand, SizeIs(1));
  EXPECT_EQ(in_hand[0].SerializeAsString(), grant.grant().leases(0).SerializeAsString());
  EXPECT_THAT(rig_->worker->MakeHeartbeat().held(), IsEmpty());
  const v1::CoordinatorMessage again = GrantAgain(grant);
  rig_->worker->OnMessage(again);
  EXPECT_THAT(rig_->worker->InHand(), IsEmpty());
  const v1::WorkerMessage message = next->Await(1)[0];
  EXPECT_EQ(message.chunk().attempt(), 100);
  EXPECT_EQ(message.chunk().pixels().SerializeAsString(), pixels);
  rig_->worker->OnMessage(Ack(again.grant().leases(0)));
  EXPECT_THAT(rig_->worker->MakeHeartbeat().held(), IsEmpty());
  EXPECT_EQ(Count("unit_rendered"), 1);
  EXPECT_EQ(Count("unit_kept"), 1);
  EXPECT_EQ(next->size(), 1u);
}

TEST_F(InHandTest, AUnitThatIsBeingRenderedGoesOnForItsNextLease) {
  rig_->assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(2);
  rig_->worker->OnMessage(grant);
  rig_->assets.AwaitFetches(1);
  const auto next = Reconnect();
  ASSERT_THAT(rig_->worker->InHand(), SizeIs(1)) << "the other one waited for the thread";
  rig_->worker->OnMessage(GrantAgain(grant));
  EXPECT_THAT(rig_->worker->MakeHeartbeat().held(), SizeIs(2));
  rig_->assets.SetOpen(true);
  EXPECT_EQ(next->Await(2)[0].chunk().attempt(), 100);
  EXPECT_EQ(next->Await(2)[1].chunk().attempt(), 101);
  EXPECT_EQ(rig_->outbox->size(), 0u);
  EXPECT_EQ(Count("unit_rendered"), 2);
  EXPECT_EQ(Count("unit_kept"), 1);
}

TEST_F(InHandTest, AUnitIsKeptOverSeveralConnections) {
  const v1::CoordinatorMessage grant = Grant(1);
  rig_->worker->OnMessage(grant);
  rig_->outbox->Await(1);
  for (int attempt = 2; attempt < 5; ++attempt) {
    const auto next = Reconnect();
    rig_->worker->OnMessage(GrantAgain(grant, attempt));
    EXPECT_EQ(next->Await(1)[0].chunk().attempt(), attempt);
  }
  Reconnect();
  EXPECT_THAT(rig_->worker->InHand(), SizeIs(1));
  EXPECT_EQ(Count("unit_rendered"), 1);
}

TEST_F(InHandTest, AUnitOfAJobThatHasChangedIsRenderedAgain) {
  const v1::CoordinatorMessage grant = Grant(1);
  rig_->worker->OnMessage(grant);
  rig_->outbox->Await(1);
  v1::JobSpec changed = Spec();
  changed.set_seed(7);
  rig_->source.Set(changed);
  const auto next = Reconnect();
  rig_->worker->OnMessage(GrantAgain(grant));
  EXPECT_EQ(next->Await(1)[0].chunk().attempt(), 100);
  EXPECT_EQ(Count("unit_rendered"), 2);
  EXPECT_EQ(Count("unit_outdated"), 1);
  EXPECT_EQ(Count("unit_kept"), 0);
}

TEST_F(InHandTest, OtherSamplesOfTheTileAreRendered) {
  v1::CoordinatorMessage grant = Grant(1);
  rig_->worker->OnMessage(grant);
  rig_->outbox->Await(1);
  const auto next = Reconnect();
  grant.mutable_grant()->mutable_leases(0)->set_last_sample(3);
  rig_->worker->OnMessage(GrantAgain(grant));
  EXPECT_EQ(next->Await(1)[0].chunk().stats().samples(), 16 * 16 * 3);
  EXPECT_THAT(rig_->worker->InHand(), IsEmpty());
}

TEST_F(InHandTest, WhatNobodyWantsIsDropped) {
  v1::CoordinatorMessage ended;
  ended.mutable_job_ended()->set_job_id("j");
  v1::CoordinatorMessage voided;
  *voided.mutable_void_leases()->add_leases() = Grant(1).grant().leases(0);
  for (const auto& drop :
       std::vector<std::function<void(LeaseRunner*)>>{[&](LeaseRunner* worker) { worker->OnMessage(ended); },
                                                      [&](LeaseRunner* worker) { worker->OnMessage(voided); },
                                                      [&](LeaseRunner* worker) { worker->DropInHand(); }}) {
    Rig rig;
    rig.assets.SetOpen(false);
    rig.worker->OnMessage(Grant(1));
    rig.assets.AwaitFetches(1);
    rig.worker->OnDisconnected();
    EXPECT_THAT(rig.worker->InHand(), SizeIs(1));
    drop(rig.worker.get());
    EXPECT_THAT(rig.worker->InHand(), IsEmpty());
    rig.assets.SetOpen(true);
    EXPECT_EQ(rig.outbox->size(), 0u);
  }
}

TEST_F(InHandTest, AFailureOfABrokenConnectionIsNoneOfTheNextLease) {
  Rig rig(absl::UnavailableError("the connection to the coordinator was lost"));
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(1));
  rig.assets.AwaitFetches(1);
  rig.worker->OnDisconnected();
  rig.worker->OnConnected(rig.outbox);
  rig.worker->OnMessage(GrantAgain(Grant(1)));
  rig.assets.SetOpen(true);
  EXPECT_EQ(rig.outbox->Await(1)[0].failure().attempt(), 100);
  EXPECT_EQ(rig.assets.fetches(), 2) << "it is tried once more, for the new lease";
}

TEST_F(InHandTest, AFailureWithoutALeaseDropsTheUnit) {
  Rig rig(absl::UnavailableError("gone"));
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(1));
  rig.assets.AwaitFetches(1);
  rig.worker->OnDisconnected();
  EXPECT_THAT(rig.worker->InHand(), SizeIs(1));
  rig.assets.SetOpen(true);
  while (!rig.worker->InHand().empty()) std::this_thread::yield();
  EXPECT_EQ(rig.outbox->size(), 0u);
}

TEST_F(InHandTest, TwoCoordinatorsMayGiveTheSameAttempts) {
  v1::CoordinatorMessage grant = Grant(2);
  v1::CoordinatorMessage other = grant;
  grant.mutable_grant()->mutable_leases()->RemoveLast();          // tile 0, attempt 1
  other.mutable_grant()->mutable_leases()->DeleteSubrange(0, 1);  // tile 1
  other.mutable_grant()->mutable_leases(0)->set_attempt(1);
  rig_->worker->OnMessage(grant);
  rig_->outbox->Await(1);
  const auto next = Reconnect();
  rig_->worker->OnMessage(other);
  EXPECT_EQ(next->Await(1)[0].chunk().unit().tile(), 1);
  EXPECT_THAT(rig_->worker->InHand(), SizeIs(1));
  Reconnect();
  EXPECT_THAT(rig_->worker->InHand(), SizeIs(2));
  EXPECT_EQ(Count("unit_rendered"), 2);
}

TEST_F(InHandTest, HasNoMoreInHandThanSlots) {
  std::shared_ptr<FakeOutbox> outbox = rig_->outbox;
  for (int i = 0; i < 4; ++i) {
    rig_->worker->OnMessage(Grant(1, "j" + std::to_string(i)));
    outbox->Await(1);
    outbox = Reconnect();
  }
  const std::vector<v1::Lease> in_hand = rig_->worker->InHand();
  ASSERT_THAT(in_hand, SizeIs(rig_->worker->slots()));
  EXPECT_EQ(in_hand.back().unit().job_id(), "j3") << "the newest ones";
}

TEST_F(InHandTest, AMoveFinishesWhatIsRenderedAndHandsBackTheRest) {
  rig_->assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(3);
  rig_->worker->OnMessage(grant);
  rig_->assets.AwaitFetches(1);
  v1::CoordinatorMessage move;
  move.mutable_move()->set_address("b:7700");
  rig_->worker->OnMessage(move);
  EXPECT_TRUE(rig_->worker->IsMoving());
  EXPECT_FALSE(rig_->worker->IsLeaving());
  EXPECT_THAT(rig_->outbox->Await(1)[0].hand_back().leases(), SizeIs(2));
  v1::CoordinatorMessage late = Grant(1, "k");
  rig_->worker->OnMessage(GrantAgain(late));
  EXPECT_EQ(rig_->outbox->Await(2)[1].hand_back().leases(0).unit().job_id(), "k");
  EXPECT_FALSE(rig_->worker->HasLeft());
  rig_->assets.SetOpen(true);
  EXPECT_TRUE(rig_->outbox->Await(3)[2].has_chunk());
  EXPECT_FALSE(rig_->worker->HasLeft()) << "it is not acknowledged";
  rig_->worker->OnMessage(Ack(grant.grant().leases(0)));
  EXPECT_TRUE(rig_->worker->HasLeft());
  rig_->worker->OnDisconnected();
  EXPECT_EQ(rig_->worker->TakeMove(), "b:7700");
  EXPECT_FALSE(rig_->worker->IsMoving());
  EXPECT_EQ(rig_->worker->TakeMove(), std::nullopt);
}

TEST_F(InHandTest, AMoveAtOnceWaitsForNoAcknowledgement) {
  rig_->assets.SetOpen(false);
  rig_->worker->OnMessage(Grant(2));
  rig_->assets.AwaitFetches(1);
  v1::CoordinatorMessage move;
  move.mutable_move()->set_address("b:7700");
  rig_->worker->OnMessage(move);
  EXPECT_FALSE(rig_->worker->HasLeft());
  move.mutable_move()->set_at_once(true);
  move.mutable_move()->clear_address();
  rig_->worker->OnMessage(move);
  EXPECT_TRUE(rig_->worker->HasLeft());
  rig_->worker->OnDisconnected();
  EXPECT_EQ(rig_->worker->TakeMove(), "") << "the coordinator that it was to go to before may be as bad";
  EXPECT_THAT(rig_->worker->InHand(), SizeIs(1)) << "the one that a thread has taken";
  rig_->assets.SetOpen(true);
}

}  // namespace
}  // namespace lumifold::worker
