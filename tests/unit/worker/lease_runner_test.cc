#include "worker/leases/lease_runner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/rpc/image_codec.h"
#include "proto/rpc/monotonic.h"
#include "tests/unit/worker/worker_rig.h"
#include "worker/units/unit_messages.h"

namespace lumifold::worker {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::SizeIs;

/// The first unit has hours of work.
v1::CoordinatorMessage LongGrant(int count) {
  v1::CoordinatorMessage grant = Grant(count);
  grant.mutable_grant()->mutable_leases(0)->set_last_sample(1 << 30);
  return grant;
}

TEST(LeaseRunner, DeliversEachLeasedUnitWhole) {
  Rig rig(std::string(kScene), Spec(), 2);
  rig.worker->OnMessage(Grant(3));
  for (const v1::WorkerMessage& message : rig.outbox->Await(3)) {
    ASSERT_TRUE(message.has_chunk());
    rpc::PixelAssembler assembler;
    ASSERT_TRUE(assembler.Add(message.chunk().pixels()).ok());
    ASSERT_TRUE(assembler.IsComplete());
    EXPECT_EQ(assembler.Take().layout.width(), 16);
    EXPECT_EQ(message.chunk().stats().samples(), 16 * 16 * 2);
  }
  EXPECT_EQ(rig.assets.fetches(), 1);  // the scene is loaded once
  EXPECT_EQ(rig.source.fetches, 1);
}

TEST(LeaseRunner, SendsTheEdgesOfATileBeforeItsGeometry) {
  Rig rig;
  v1::CoordinatorMessage grant = Grant(1);
  grant.mutable_grant()->mutable_leases(0)->mutable_unit()->set_kind(v1::UNIT_KIND_GEOMETRY);
  rig.worker->OnMessage(grant);
  const std::vector<v1::WorkerMessage> messages = rig.outbox->Await(2);
  ASSERT_TRUE(messages[0].chunk().has_edges());
  EXPECT_FALSE(messages[0].chunk().has_pixels());
  EXPECT_FALSE(messages[0].chunk().has_stats());
  rpc::PixelAssembler assembler;
  ASSERT_TRUE(assembler.Add(messages[0].chunk().edges()).ok());
  ASSERT_TRUE(assembler.IsComplete());
  EXPECT_EQ(assembler.Take().layout.width(), kSubSamples);
  EXPECT_TRUE(messages[1].chunk().has_pixels());
  EXPECT_TRUE(messages[1].chunk().has_stats());
}

TEST(UnitMessages, TheFragmentsOfAPassComeBeforeItsPixels) {
  const v1::Lease lease = Grant(1).grant().leases(0);
  RenderedUnit unit;
  unit.image.pixels = LayeredImage(3, 2);
  unit.image.pixels.Add("samples_a.Y");
  unit.image.fragments = LayeredImage(1, 5);
  unit.image.fragments.Add("surface.Y");
  std::vector<v1::WorkerMessage> messages;
  SendUnit(lease, unit, [&](v1::WorkerMessage message) { messages.push_back(std::move(message)); });
  ASSERT_THAT(messages, SizeIs(2));
  EXPECT_EQ(messages[0].chunk().edges().layout().height(), 5);
  EXPECT_FALSE(messages[0].chunk().has_pixels());
  EXPECT_EQ(messages[1].chunk().pixels().layout().width(), 3);
  EXPECT_TRUE(messages[1].chunk().has_stats());
}

TEST(LeaseRunner, TriesAUnitAgainForWhichThereWasNoMemory) {
  Rig rig;
  rig.assets.FindNoMemory(1);
  rig.worker->OnMessage(Grant(1));
  EXPECT_TRUE(rig.outbox->Await(1)[0].has_chunk());
  EXPECT_EQ(rig.assets.fetches(), 2);
}

TEST(LeaseRunner, HandsTheJobBackWhenItHasNotTheMemory) {
  Rig rig;
  rig.assets.FindNoMemory(2);
  rig.worker->OnMessage(Grant(3));
  const std::vector<v1::WorkerMessage> sent = rig.outbox->Await(2);
  ASSERT_TRUE(sent[0].has_hand_back()) << sent[0].DebugString();
  EXPECT_EQ(sent[0].hand_back().leases_size(), 2);
  ASSERT_TRUE(sent[1].has_failure());
  EXPECT_TRUE(sent[1].failure().out_of_memory());
  EXPECT_FALSE(sent[1].failure().permanent());
  EXPECT_THAT(sent[1].failure().error(), HasSubstr("not enough memory for the scene"));
  // It goes on.
  rig.worker->OnMessage(Grant(1, "k"));
  EXPECT_TRUE(rig.outbox->Await(3)[2].has_chunk());
}

TEST(LeaseRunner, HoldsLeasesUntilTheyAreAcknowledged) {
  Rig rig;
  const v1::CoordinatorMessage grant = Grant(2);
  rig.worker->OnMessage(grant);
  rig.outbox->Await(2);
  EXPECT_THAT(rig.worker->MakeHeartbeat().held(), SizeIs(2));
  rig.worker->OnMessage(Ack(grant.grant().leases(0)));
  ASSERT_THAT(rig.worker->MakeHeartbeat().held(), SizeIs(1));
  EXPECT_EQ(rig.worker->MakeHeartbeat().held(0).unit().tile(), 1);
  EXPECT_EQ(rig.worker->MakeHeartbeat().newest_attempt(), 2);
}

TEST(LeaseRunner, NamesTheLeasesOfAGrantBeforeItBegins) {
  Rig rig;
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(2));
  const std::vector<v1::WorkerMessage> sent = rig.outbox->heartbeats();
  ASSERT_THAT(sent, SizeIs(1));
  EXPECT_THAT(sent[0].heartbeat().held(), SizeIs(2));
  EXPECT_EQ(sent[0].heartbeat().newest_attempt(), 0) << "nothing is said of other leases";
  EXPECT_EQ(rig.outbox->size(), 0u);
  rig.assets.SetOpen(true);
}

TEST(LeaseRunner, CountsLeasesAndUnits) {
  Rig rig;
  rig.assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(3);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);
  monitoring::WorkerMetrics metrics = rig.worker->Metrics();
  EXPECT_THAT(metrics.leases, ElementsAre(Pair("delivered", 0), Pair("rendering", 1), Pair("waiting", 2)));
  EXPECT_EQ(metrics.units_rendered, 0);
  rig.assets.SetOpen(true);
  rig.outbox->Await(3);
  v1::CoordinatorMessage refusal = Ack(grant.grant().leases(0));
  refusal.mutable_ack()->set_refused("damaged");
  rig.worker->OnMessage(refusal);
  metrics = rig.worker->Metrics();
  EXPECT_THAT(metrics.leases, ElementsAre(Pair("delivered", 2), Pair("rendering", 0), Pair("waiting", 0)));
  EXPECT_EQ(metrics.units_rendered, 3);
  EXPECT_EQ(metrics.samples, 3 * 16 * 16 * 2);
  EXPECT_GE(metrics.rays, metrics.samples);
  EXPECT_EQ(metrics.failures.at("refused"), 1);
  rig.worker->OnDisconnected();
  EXPECT_EQ(rig.worker->Metrics().leases.at("delivered"), 0);
}

TEST(LeaseRunner, ReportsTheProgressOfItsLeases) {
  Rig rig;
  rig.assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(3);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);
  const v1::Heartbeat before = rig.worker->MakeHeartbeat();
  for (int i = 0; i < 3; ++i) {  // neither the unit that waits for its scene nor those behind it advance
    EXPECT_EQ(before.held(i).progress(), rig.worker->MakeHeartbeat().held(i).progress());
  }
  rig.assets.SetOpen(true);
  rig.outbox->Await(3);
  rig.worker->OnMessage(Ack(grant.grant().leases(0)));
  const v1::Heartbeat after = rig.worker->MakeHeartbeat();
  for (const v1::Lease& lease : after.held()) EXPECT_GE(lease.progress(), 16) << "rows of the tile";
}

TEST(LeaseRunner, ALeaseThatWaitsAdvancesWithTheWorker) {
  Rig rig;
  const v1::CoordinatorMessage first = Grant(1, "j");
  rig.worker->OnMessage(first);
  rig.outbox->Await(1);
  rig.worker->OnMessage(Ack(first.grant().leases(0)));
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(2, "k"));  // of another scene, which is not there yet
  rig.assets.AwaitFetches(2);
  EXPECT_GE(rig.worker->MakeHeartbeat().held(1).progress(), 16) << "of the unit that is done";
  rig.assets.SetOpen(true);
}

TEST(LeaseRunner, DropsWhatALostConnectionLeased) {
  Rig rig;
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(2));
  rig.assets.AwaitFetches(1);  // the first unit is being rendered
  rig.worker->OnDisconnected();
  const auto next = std::make_shared<FakeOutbox>();
  rig.worker->OnConnected(next);
  EXPECT_THAT(rig.worker->MakeHeartbeat().held(), SizeIs(0));
  rig.assets.SetOpen(true);
  rig.worker->OnMessage(Grant(1));
  next->Await(1);
  rig.worker.reset();
  EXPECT_EQ(rig.outbox->size(), 0u);
  EXPECT_EQ(next->size(), 1u);
}

TEST(LeaseRunner, RendersAUnitAgainThatALostConnectionLeased) {
  Rig rig;
  v1::CoordinatorMessage grant = Grant(1);
  rig.worker->OnMessage(grant);
  const std::string pixels = rig.outbox->Await(1)[0].chunk().pixels().SerializeAsString();
  rig.worker->OnDisconnected();
  const auto next = std::make_shared<FakeOutbox>();
  rig.worker->OnConnected(next);
  grant.mutable_grant()->mutable_leases(0)->set_attempt(100);
  rig.worker->OnMessage(grant);
  const v1::WorkerMessage message = next->Await(1)[0];
  EXPECT_EQ(message.chunk().attempt(), 100);
  EXPECT_EQ(message.chunk().pixels().SerializeAsString(), pixels);
  EXPECT_EQ(rig.worker->Metrics().units_rendered, 2);
}

TEST(LeaseRunner, StopsWhatALostConnectionLeased) {
  Rig rig;
  rig.worker->OnMessage(LongGrant(1));
  rig.assets.AwaitFetches(1);
  rig.worker->OnDisconnected();
  const auto next = std::make_shared<FakeOutbox>();
  rig.worker->OnConnected(next);
  rig.worker->OnMessage(Grant(1));
  EXPECT_TRUE(next->Await(1)[0].has_chunk()) << "its only thread is free";
  EXPECT_EQ(rig.worker->Metrics().units_rendered, 1);
}

TEST(LeaseRunner, AFailureOfALostConnectionIsNoneOfTheNextLease) {
  Rig rig(absl::UnavailableError("the connection to the coordinator was lost"));
  rig.assets.SetOpen(false);
  v1::CoordinatorMessage grant = Grant(1);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);
  rig.worker->OnDisconnected();
  rig.worker->OnConnected(rig.outbox);
  grant.mutable_grant()->mutable_leases(0)->set_attempt(100);
  rig.worker->OnMessage(grant);
  rig.assets.SetOpen(true);
  EXPECT_EQ(rig.outbox->Await(1)[0].failure().attempt(), 100);
  EXPECT_EQ(rig.assets.fetches(), 2) << "it is tried once more, for the new lease";
}

TEST(LeaseRunner, ForgetsAnEndedJob) {
  Rig rig;
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(4));
  rig.assets.AwaitFetches(1);
  v1::CoordinatorMessage ended;
  ended.mutable_job_ended()->set_job_id("j");
  rig.worker->OnMessage(ended);
  EXPECT_THAT(rig.worker->MakeHeartbeat().held(), SizeIs(0));
  rig.assets.SetOpen(true);
  rig.worker.reset();
  EXPECT_EQ(rig.outbox->size(), 0u);
}

TEST(LeaseRunner, DropsTheLeasesOfAJobThatEndedBeforeItsSpecWasFetched) {
  Rig rig(std::string(kScene), absl::NotFoundError("no active job 'j'"));
  rig.worker->OnMessage(Grant(3));
  while (rig.worker->MakeHeartbeat().held_size() > 0) std::this_thread::yield();
  EXPECT_EQ(rig.outbox->size(), 0u) << "neither a unit nor a failure";
}

TEST(LeaseRunner, ASpecThatCannotBeFetchedIsNoFaultOfTheJob) {
  Rig rig(std::string(kScene), absl::UnavailableError("gone"));
  rig.worker->OnMessage(Grant(1));
  const v1::WorkerMessage message = rig.outbox->Await(1).front();
  ASSERT_TRUE(message.has_failure());
  EXPECT_FALSE(message.failure().permanent());
}

v1::CoordinatorMessage Released() {
  v1::CoordinatorMessage message;
  message.mutable_released();
  return message;
}

TEST(LeaseRunner, LeavesAfterItsUnitsAreAcknowledgedAndHandsBackThoseThatWait) {
  Rig rig;
  rig.assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(3);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);  // the first unit is being rendered
  rig.worker->Leave("signal");
  rig.worker->Leave("idle");
  const std::vector<v1::WorkerMessage> messages = rig.outbox->Await(2);
  EXPECT_EQ(messages[0].leaving().reason(), "signal");
  ASSERT_EQ(messages[1].hand_back().leases_size(), 2);
  EXPECT_EQ(messages[1].hand_back().leases(0).attempt(), 2);
  EXPECT_EQ(messages[1].hand_back().leases(1).attempt(), 3);
  v1::CoordinatorMessage late = Grant(1, "k");  // sent before the coordinator heard of it
  late.mutable_grant()->mutable_leases(0)->set_attempt(4);
  rig.worker->OnMessage(late);
  EXPECT_EQ(rig.outbox->Await(3)[2].hand_back().leases(0).unit().job_id(), "k");
  rig.worker->OnMessage(Released());
  EXPECT_FALSE(rig.worker->HasLeft());
  rig.assets.SetOpen(true);
  EXPECT_TRUE(rig.outbox->Await(4)[3].has_chunk());
  rig.worker->HandBackUnfinished();  // not of a unit that is delivered
  EXPECT_FALSE(rig.worker->HasLeft());
  rig.worker->OnMessage(Ack(grant.grant().leases(0)));
  EXPECT_TRUE(rig.worker->HasLeft());
  EXPECT_EQ(rig.outbox->size(), 4u);
}

TEST(LeaseRunner, HandsBackWhatItCannotFinishInTime) {
  Rig rig;
  rig.worker->OnMessage(LongGrant(1));
  rig.assets.AwaitFetches(1);
  v1::CoordinatorMessage drain;
  drain.mutable_drain();
  rig.worker->OnMessage(drain);
  EXPECT_EQ(rig.outbox->Await(1)[0].leaving().reason(), "drained");
  EXPECT_FALSE(rig.worker->HasLeft());
  rig.worker->HandBackUnfinished();
  EXPECT_EQ(rig.outbox->Await(2)[1].hand_back().leases_size(), 1);
  EXPECT_FALSE(rig.worker->HasLeft()) << "a grant may be under way";
  rig.worker->OnMessage(Released());
  EXPECT_TRUE(rig.worker->HasLeft());
}  // the destructor waits for the unit that is no longer wanted

TEST(LeaseRunner, AWorkerThatRestsFinishesAndKeepsItsConnection) {
  Rig rig;
  rig.assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(2);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);
  for (int i = 0; i < 3; ++i) rig.worker->Rest("off hours until 19:00");
  const std::vector<v1::WorkerMessage> messages = rig.outbox->Await(2);
  EXPECT_EQ(messages[0].rest().reason(), "off hours until 19:00");
  EXPECT_THAT(messages[1].hand_back().leases(), SizeIs(1));
  v1::CoordinatorMessage late = Grant(1, "k");
  late.mutable_grant()->mutable_leases(0)->set_attempt(100);
  rig.worker->OnMessage(late);
  EXPECT_EQ(rig.outbox->Await(3)[2].hand_back().leases(0).unit().job_id(), "k");
  EXPECT_FALSE(rig.worker->IsLeaving());
  rig.assets.SetOpen(true);
  EXPECT_TRUE(rig.outbox->Await(4)[3].has_chunk());
  rig.worker->Rest("");
  EXPECT_EQ(rig.outbox->Await(5)[4].message_case(), v1::WorkerMessage::kRest);
  EXPECT_FALSE(rig.worker->HasLeft());
}

TEST(LeaseRunner, ADrainMayWaitForUnitsAndASignalEndsThat) {
  Rig rig;
  v1::CoordinatorMessage drain;
  drain.mutable_drain()->set_finish_units(true);
  rig.worker->OnMessage(drain);
  EXPECT_TRUE(rig.worker->FinishesUnits());
  rig.worker->Leave("signal");
  EXPECT_FALSE(rig.worker->FinishesUnits());
  rig.worker->OnMessage(drain);
  EXPECT_FALSE(rig.worker->FinishesUnits());
}

TEST(LeaseRunner, AMoveFinishesWhatIsRenderedAndHandsBackTheRest) {
  Rig rig;
  rig.assets.SetOpen(false);
  const v1::CoordinatorMessage grant = Grant(3);
  rig.worker->OnMessage(grant);
  rig.assets.AwaitFetches(1);
  v1::CoordinatorMessage move;
  move.mutable_move()->set_address("b:7700");
  rig.worker->OnMessage(move);
  EXPECT_TRUE(rig.worker->IsMoving());
  EXPECT_FALSE(rig.worker->IsLeaving());
  EXPECT_THAT(rig.outbox->Await(1)[0].hand_back().leases(), SizeIs(2));
  v1::CoordinatorMessage late = Grant(1, "k");
  late.mutable_grant()->mutable_leases(0)->set_attempt(100);
  rig.worker->OnMessage(late);
  EXPECT_EQ(rig.outbox->Await(2)[1].hand_back().leases(0).unit().job_id(), "k");
  EXPECT_FALSE(rig.worker->HasLeft());
  rig.assets.SetOpen(true);
  EXPECT_TRUE(rig.outbox->Await(3)[2].has_chunk());
  EXPECT_FALSE(rig.worker->HasLeft()) << "it is not acknowledged";
  rig.worker->OnMessage(Ack(grant.grant().leases(0)));
  EXPECT_TRUE(rig.worker->HasLeft());
  rig.worker->OnDisconnected();
  EXPECT_EQ(rig.worker->TakeMove(), "b:7700");
  EXPECT_FALSE(rig.worker->IsMoving());
  EXPECT_EQ(rig.worker->TakeMove(), std::nullopt);
}

TEST(LeaseRunner, AMoveAtOnceWaitsForNoAcknowledgement) {
  Rig rig;
  rig.assets.SetOpen(false);
  rig.worker->OnMessage(Grant(2));
  rig.assets.AwaitFetches(1);
  v1::CoordinatorMessage move;
  move.mutable_move()->set_address("b:7700");
  rig.worker->OnMessage(move);
  EXPECT_FALSE(rig.worker->HasLeft());
  move.mutable_move()->set_at_once(true);
  move.mutable_move()->clear_address();
  rig.worker->OnMessage(move);
  EXPECT_TRUE(rig.worker->HasLeft());
  rig.worker->OnDisconnected();
  EXPECT_EQ(rig.worker->TakeMove(), "") << "the coordinator that it was to go to before may be as bad";
  rig.assets.SetOpen(true);
}

TEST(LeaseRunner, StopsRenderingAUnitWhoseLeaseIsVoid) {
  Rig rig;
  const v1::CoordinatorMessage grant = LongGrant(2);
  rig.worker->OnMessage(grant);
  v1::CoordinatorMessage voided;
  *voided.mutable_void_leases()->add_leases() = grant.grant().leases(0);
  rig.worker->OnMessage(voided);
  const v1::WorkerMessage message = rig.outbox->Await(1)[0];  // of the second, which has the thread now
  EXPECT_EQ(message.chunk().unit().tile(), 1);
  EXPECT_THAT(rig.worker->MakeHeartbeat().held(), SizeIs(1));
}

TEST(LeaseRunner, KnowsSinceWhenItIsIdle) {
  Rig rig;
  const absl::Time start = rig.worker->IdleSince();
  EXPECT_LE(start, rpc::MonotonicNow());
  const v1::CoordinatorMessage grant = Grant(1);
  rig.worker->OnMessage(grant);
  EXPECT_EQ(rig.worker->IdleSince(), absl::InfiniteFuture());
  rig.outbox->Await(1);
  rig.worker->OnMessage(Ack(grant.grant().leases(0)));
  EXPECT_GT(rig.worker->IdleSince(), start);
  EXPECT_LE(rig.worker->IdleSince(), rpc::MonotonicNow());
}

TEST(LeaseRunner, NamesTheAssetThatTheCoordinatorLost) {
  for (const absl::Status& lost : {absl::NotFoundError("no asset"), absl::DataLossError("SHA-256")}) {
    v1::JobSpec spec = Spec();
    spec.mutable_scene()->mutable_file()->set_sha256("5ca1ab1e");
    Rig rig(lost, spec);
    rig.worker->OnMessage(Grant(1));
    const v1::WorkerMessage message = rig.outbox->Await(1).front();
    EXPECT_FALSE(message.failure().permanent());
    EXPECT_EQ(message.failure().missing_asset().sha256(), "5ca1ab1e");
    EXPECT_EQ(rig.worker->Metrics().failures.at("missing_asset"), 1);
  }
}

TEST(LeaseRunner, SaysThatABrokenSceneIsBrokenForEveryone) {
  Rig rig(std::string("this is no scene"));
  rig.worker->OnMessage(Grant(1));
  const v1::WorkerMessage message = rig.outbox->Await(1).front();
  ASSERT_TRUE(message.has_failure());
  EXPECT_TRUE(message.failure().permanent());
  EXPECT_FALSE(message.failure().has_missing_asset());
  EXPECT_EQ(rig.worker->Metrics().failures.at("permanent"), 1);
  EXPECT_THAT(message.failure().error(), HasSubstr("triangle.gltf"));
}

TEST(LeaseRunner, SaysThatALostCoordinatorIsNoFaultOfTheJob) {
  Rig rig(absl::UnavailableError("gone"));
  rig.worker->OnMessage(Grant(1));
  EXPECT_FALSE(rig.outbox->Await(1).front().failure().permanent());
  EXPECT_EQ(rig.worker->Metrics().failures.at("transient"), 1);
}

TEST(UnitRenderer, NamesAnEnvironmentThatIsNoPicture) {
  FakeAssets assets{std::string(kScene)};  // also the content of the environment map
  UnitRenderer renderer(&assets);
  v1::JobSpec spec = Spec();
  spec.mutable_scene()->add_dependencies()->set_uri("environment:sky.exr");
  spec.mutable_environment()->set_uri("environment:sky.exr");
  spec.mutable_environment()->set_scale(1);
  UnitControl control;
  const auto unit = renderer.Render(spec, Grant(1).grant().leases(0), &control);
  EXPECT_TRUE(IsPermanent(unit.status()));
  EXPECT_THAT(std::string(unit.status().message()), HasSubstr("sky.exr: neither an OpenEXR nor"));
}

TEST(UnitRenderer, RendersTheEnvironment) {
  FakeAssets assets{std::string(kScene), "#?RADIANCE\n\n-Y 1 +X 1\n\x80\x80\x80\x81"};
  UnitRenderer renderer(&assets);
  v1::JobSpec spec = Spec();
  spec.mutable_scene()->add_dependencies()->set_uri("environment:sky.hdr");
  spec.mutable_environment()->set_uri("environment:sky.hdr");
  spec.mutable_environment()->set_scale(3);
  UnitControl control;
  const auto unit = renderer.Render(spec, Grant(1).grant().leases(0), &control);
  ASSERT_TRUE(unit.ok()) << unit.status();
  EXPECT_EQ(unit->image.pixels.GetColor("emission")[0].At(0, 0),
            2 * 3);  // two samples of the corner, environment only
}

}  // namespace
}  // namespace lumifold::worker
