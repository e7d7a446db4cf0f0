// A worker's connection against the interface that the coordinator implements: without a farm.
#include "server/services/worker_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "proto/rpc/image_codec.h"
#include "proto/rpc/limits.h"
#include "server/access/identity.h"
#include "server/coordinator/roles.h"
#include "tests/support/random_unit.h"

namespace lumifold::server {
namespace {

using testing::_;
using testing::AllOf;
using testing::Field;
using testing::HasSubstr;
using testing::Return;
using testing::StrictMock;

const job::WorkerId kWorker(7);
const job::Attempt kAttempt(3);

class MockWorkerApi : public WorkerApi {
 public:
  MOCK_METHOD(absl::StatusOr<job::WorkerId>, AddWorker,
              (const v1::Hello& hello, const access::Identity& caller, WorkerSink* sink), (override));
  MOCK_METHOD(void, RemoveWorker, (job::WorkerId), (override));
  MOCK_METHOD(void, OnHeartbeat, (job::WorkerId, const v1::Heartbeat&), (override));
  MOCK_METHOD(void, KeepLog, (job::WorkerId, (const google::protobuf::RepeatedPtrField<v1::LogEvent>&)),
              (override));
  MOCK_METHOD(void, OnLeaving, (job::WorkerId, const std::string&), (override));
  MOCK_METHOD(void, OnRest, (job::WorkerId, const std::string&), (override));
  MOCK_METHOD(std::optional<LeasedUnit>, FindLease, (job::WorkerId, const job::UnitRef&, job::Attempt),
              (override));
  MOCK_METHOD(void, Deliver, (job::WorkerId, film::EncodedUnit), (override));
  MOCK_METHOD(void, Keep, (job::WorkerId, const KeptUnit&), (override));
  MOCK_METHOD(absl::Status, DeliverPlan, (job::WorkerId, const job::UnitRef&, job::Attempt, const v1::Plan&),
              (override));
  MOCK_METHOD(void, Dismiss, (job::WorkerId, const job::UnitRef&, job::Attempt), (override));
  MOCK_METHOD(void, RefuseUnit, (job::WorkerId, const job::UnitRef&, job::Attempt, const std::string&),
              (override));
  MOCK_METHOD(void, FailUnit,
              (job::WorkerId, const job::UnitRef&, job::Attempt, const scheduler::UnitFailure&), (override));
  MOCK_METHOD(void, HandBack, (job::WorkerId, const v1::HandBack&), (override));
  MOCK_METHOD(absl::StatusOr<v1::JobSpec>, FetchSpec, (const v1::FetchSpecRequest&, const std::string&),
              (override));
  MOCK_METHOD(absl::Status, CheckFetch, (const v1::FetchAssetRequest&, const std::string&), (override));
  MOCK_METHOD(absl::StatusOr<rpc::ByteSender>, OpenAsset, (const v1::FetchAssetRequest&), (const, override));
  MOCK_METHOD(absl::StatusOr<UnitSender>, OpenUnits, (const v1::FetchUnitsRequest&, const std::string&),
              (override));
  MOCK_METHOD(absl::StatusOr<std::unique_ptr<ResultUpload>>, ReceiveResult,
              (const v1::ResultAnnouncement&, const std::string&), (override));
  MOCK_METHOD(void, OnAssetMissing,
              (job::WorkerId, const job::UnitRef&, job::Attempt, const std::string&, const std::string&),
              (override));
};

class NoSink final : public WorkerSink {
 public:
  void Send(const v1::CoordinatorMessage& /*message*/) override {}
};

class WorkerSessionTest : public testing::Test {
 protected:
  WorkerSessionTest() {
    EXPECT_CALL(workers_, AddWorker(_, _, &sink_)).WillOnce(Return(kWorker));
    EXPECT_CALL(workers_, KeepLog(kWorker, _)).Times(testing::AnyNumber());
    EXPECT_CALL(workers_, RemoveWorker(kWorker));
    session_ = *WorkerSession::Open(&workers_, {}, access::LocalIdentity(), &sink_);
  }

  static job::UnitRef Unit(v1::UnitKind kind = v1::UNIT_KIND_PASS) {
    return {job::JobId("j-1"), {0, 0, 0, kind}};
  }
  void Lease(const job::UnitRef& unit) {
    const TileSamples samples(kSamples);
    ON_CALL(workers_, FindLease(kWorker, unit, kAttempt))
        .WillByDefault(Return(LeasedUnit{.rect = kRect, .samples = samples, .model = {}}));
    EXPECT_CALL(workers_, FindLease(kWorker, unit, kAttempt)).Times(testing::AnyNumber());
  }
  /// The messages that deliver a unit.
  static std::vector<v1::WorkerMessage> Chunks(const job::UnitRef& unit) {
    const EdgedImage image = RandomUnit(unit.key, kRect, kSamples, 1);
    v1::WorkerMessage message;
    *message.mutable_chunk()->mutable_unit() = ProtoFromUnit(unit);
    message.mutable_chunk()->set_attempt(kAttempt.value());
    std::vector<v1::WorkerMessage> messages;
    if (ListOf(image).height() > 0) {
      rpc::PixelChunker list(ListOf(image));
      while (list.Next(message.mutable_chunk()->mutable_edges())) messages.push_back(message);
      message.mutable_chunk()->clear_edges();
    }
    rpc::PixelChunker pixels(image.pixels);
    while (pixels.Next(message.mutable_chunk()->mutable_pixels())) messages.push_back(message);
    return messages;
  }
  absl::Status Handle(v1::WorkerMessage message) { return session_->Handle(&message); }

  static constexpr Rect kRect = {0, 0, 8, 8};
  static constexpr SampleRange kSamples = {0, 4};
  NoSink sink_;
  StrictMock<MockWorkerApi> workers_;
  std::unique_ptr<WorkerSession> session_;
};

TEST_F(WorkerSessionTest, DeliversAUnitWholeAndOnce) {
  const job::UnitRef unit = Unit();
  Lease(unit);
  EXPECT_CALL(workers_, Deliver(kWorker, _)).WillOnce([&](job::WorkerId, const film::EncodedUnit& delivered) {
    EXPECT_EQ(delivered.unit, unit);
    EXPECT_EQ(delivered.attempt, kAttempt);
    EXPECT_FALSE(delivered.digest.empty());
  });
  for (const v1::WorkerMessage& message : Chunks(unit)) EXPECT_TRUE(Handle(message).ok());
}

TEST_F(WorkerSessionTest, DropsAUnitThatIsNotLeasedAndSaysSoAtItsEnd) {
  EXPECT_CALL(workers_, FindLease(kWorker, Unit(), kAttempt)).WillRepeatedly(Return(std::nullopt));
  v1::WorkerMessage first = Chunks(Unit()).back();
  first.mutable_chunk()->mutable_pixels()->set_last(false);
  EXPECT_TRUE(Handle(first).ok());  // nothing is said before the last piece
  EXPECT_CALL(workers_, Dismiss(kWorker, Unit(), kAttempt));
  EXPECT_TRUE(Handle(Chunks(Unit()).back()).ok());
}

TEST_F(WorkerSessionTest, RefusesAUnitThatIsNotValid) {
  Lease(Unit());
  v1::WorkerMessage message = Chunks(Unit()).back();
  message.mutable_chunk()->mutable_pixels()->set_data("too short");
  EXPECT_CALL(workers_, RefuseUnit(kWorker, Unit(), kAttempt, testing::Not("")));
  EXPECT_TRUE(Handle(message).ok()) << "it is a fault of the unit, not of the stream";
}

TEST_F(WorkerSessionTest, RefusesPixelsOfAPlanUnitAndPlansOfOthers) {
  const job::UnitRef plan_unit = Unit(v1::UNIT_KIND_PLAN);
  Lease(plan_unit);
  v1::WorkerMessage pixels = Chunks(Unit()).back();
  *pixels.mutable_chunk()->mutable_unit() = ProtoFromUnit(plan_unit);
  EXPECT_CALL(workers_, RefuseUnit(kWorker, plan_unit, kAttempt, HasSubstr("has no pixels")));
  EXPECT_TRUE(Handle(pixels).ok());
  v1::WorkerMessage plan;
  *plan.mutable_plan()->mutable_unit() = ProtoFromUnit(Unit());
  plan.mutable_plan()->set_attempt(kAttempt.value());
  EXPECT_CALL(workers_, RefuseUnit(kWorker, Unit(), kAttempt, HasSubstr("a plan was delivered")));
  EXPECT_TRUE(Handle(plan).ok());
}

TEST_F(WorkerSessionTest, PassesOnAPlanWithBoundedTexts) {
  const job::UnitRef unit = Unit(v1::UNIT_KIND_PLAN);
  v1::WorkerMessage message;
  *message.mutable_plan()->mutable_unit() = ProtoFromUnit(unit);
  message.mutable_plan()->set_attempt(kAttempt.value());
  message.mutable_plan()->mutable_plan()->add_decisions()->set_reason(std::string(100'000, 'x'));
  message.mutable_plan()->mutable_plan()->set_memory_bytes(12345);
  message.mutable_plan()->mutable_plan()->set_numeric_class("its own");  // is the coordinator's to say
  EXPECT_CALL(workers_, DeliverPlan(kWorker, unit, kAttempt, _))
      .WillOnce([](job::WorkerId, const job::UnitRef&, job::Attempt, const v1::Plan& plan) {
        EXPECT_LE(plan.decisions(0).reason().size(), rpc::kMaxReasonBytes);
        EXPECT_EQ(plan.memory_bytes(), 12345u);
        EXPECT_EQ(plan.numeric_class(), "");
        return absl::InvalidArgumentError("not valid");
      });
  EXPECT_CALL(workers_, RefuseUnit(kWorker, unit, kAttempt, "not valid"));
  EXPECT_TRUE(Handle(message).ok());
}

TEST_F(WorkerSessionTest, TellsFailuresApart) {
  v1::WorkerMessage message;
  *message.mutable_failure()->mutable_unit() = ProtoFromUnit(Unit());
  message.mutable_failure()->set_attempt(kAttempt.value());
  message.mutable_failure()->set_error("two\nlines");
  message.mutable_failure()->set_permanent(true);
  message.mutable_failure()->set_out_of_memory(true);
  EXPECT_CALL(workers_, FailUnit(kWorker, Unit(), kAttempt,
                                 AllOf(Field(&scheduler::UnitFailure::error, "two lines"),
                                       Field(&scheduler::UnitFailure::permanent, true),
                                       Field(&scheduler::UnitFailure::out_of_memory, true))));
  EXPECT_TRUE(Handle(message).ok());
  message.mutable_failure()->mutable_missing_asset()->set_sha256("f");
  EXPECT_CALL(workers_, OnAssetMissing(kWorker, Unit(), kAttempt, "f", "two lines"));
  EXPECT_TRUE(Handle(message).ok());
}

TEST_F(WorkerSessionTest, AHeartbeatDropsPiecesOfUnitsThatAreNoLongerLeased) {
  Lease(Unit());
  const std::vector<v1::WorkerMessage> chunks = Chunks(Unit());
  ASSERT_GT(chunks.size(), 1);
  EXPECT_TRUE(Handle(chunks.front()).ok());
  EXPECT_CALL(workers_, OnHeartbeat(kWorker, _));
  EXPECT_CALL(workers_, FindLease(kWorker, Unit(), kAttempt))
      .WillOnce(Return(std::nullopt))
      .RetiresOnSaturation();
  v1::WorkerMessage heartbeat;
  heartbeat.mutable_heartbeat();
  EXPECT_TRUE(Handle(heartbeat).ok());
  // It is sent again from its beginning.
  EXPECT_CALL(workers_, Deliver(kWorker, _));
  for (const v1::WorkerMessage& message : chunks) EXPECT_TRUE(Handle(message).ok());
}

TEST_F(WorkerSessionTest, ASecondHelloEndsTheStream) {
  v1::WorkerMessage message;
  message.mutable_hello();
  EXPECT_EQ(Handle(message).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Handle({}).code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(WorkerSessionTest, PassesOnLeavingAndHandBack) {
  v1::WorkerMessage leaving;
  leaving.mutable_leaving()->set_reason("idle");
  EXPECT_CALL(workers_, OnLeaving(kWorker, "idle"));
  EXPECT_TRUE(Handle(leaving).ok());
  v1::WorkerMessage rest;
  rest.mutable_rest()->set_reason("off\nhours");
  EXPECT_CALL(workers_, OnRest(kWorker, "off hours"));
  EXPECT_TRUE(Handle(rest).ok());
  v1::WorkerMessage back;
  back.mutable_hand_back();
  EXPECT_CALL(workers_, HandBack(kWorker, _));
  EXPECT_TRUE(Handle(back).ok());
}

}  // namespace
}  // namespace lumifold::server
