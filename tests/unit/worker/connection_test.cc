// A worker's stream, from Hello to its end, with coordinators that follow a script.
#include "worker/connection/connection.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/version.h"
#include "proto/threads/event.h"
#include "tests/unit/worker/worker_rig.h"
#include "worker/render/renderer.h"

namespace lumifold::worker {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

using WorkStream = grpc::ServerReaderWriter<v1::CoordinatorMessage, v1::WorkerMessage>;

/// A coordinator behind a real socket, which does on each stream what the test says, after Hello.
class ScriptedCoordinator final : public v1::WorkerService::Service {
 public:
  using Script = std::function<grpc::Status(WorkStream&)>;

  explicit ScriptedCoordinator(Script script) : script_(std::move(script)) {
    int port = 0;
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    address_ = absl::StrCat("127.0.0.1:", port);
  }
  ~ScriptedCoordinator() override { server_->Shutdown(std::chrono::system_clock::now()); }

  const std::string& address() const { return address_; }
  std::vector<v1::Hello> hellos() {
    absl::MutexLock lock(&mutex_);
    return hellos_;
  }
  std::vector<std::string> fetches() {
    absl::MutexLock lock(&mutex_);
    return fetches_;
  }
  /// Whether a stream was broken by the worker, where it should have closed it.
  bool was_broken() {
    absl::MutexLock lock(&mutex_);
    return was_broken_;
  }
  /// Specs are answered from now on.
  void AnswerSpecs() { answers_.Notify(); }

 private:
  grpc::Status Work(grpc::ServerContext* context, WorkStream* stream) override {
    v1::WorkerMessage message;
    if (!stream->Read(&message) || !message.has_hello())
      return {grpc::StatusCode::INVALID_ARGUMENT, "the first message is no Hello"};
    {
      absl::MutexLock lock(&mutex_);
      hellos_.push_back(message.hello());
    }
    const grpc::Status status = script_(*stream);
    absl::MutexLock lock(&mutex_);
    was_broken_ = was_broken_ || context->IsCancelled();
    return status;
  }
  grpc::Status FetchSpec(grpc::ServerContext*, const v1::FetchSpecRequest* request,
                         v1::JobSpec* spec) override {
    answers_.WaitFor(absl::Seconds(60));
    Note(request->ShortDebugString());
    *spec = Spec();
    v1::AssetRef* const file = spec->mutable_scene()->mutable_file();
    file->set_uri("triangle.gltf");
    file->set_sha256(rpc::Sha256Hex(kScene));
    file->set_size(std::string(kScene).size());
    return grpc::Status::OK;
  }
  grpc::Status FetchAsset(grpc::ServerContext*, const v1::FetchAssetRequest* request,
                          grpc::ServerWriter<v1::ByteChunk>* writer) override {
    Note(absl::StrCat(request->job_id(), " ", request->worker_id(), " ", request->offset(), " ",
                      request->sha256() == rpc::Sha256Hex(kScene) ? "the scene" : "another"));
    const std::string rest = std::string(kScene).substr(request->offset(), 100);
    v1::ByteChunk chunk;
    chunk.set_data(rest);
    chunk.set_offset(request->offset());
    chunk.set_checksum(rpc::Checksum(rest));
    writer->Write(chunk);
    // It breaks once, and the worker goes on where it stopped.
    if (request->offset() == 0) return {grpc::StatusCode::UNAVAILABLE, "broken"};
    for (size_t offset = request->offset() + 100; offset < std::string(kScene).size(); offset += 100) {
      chunk.set_data(std::string(kScene).substr(offset, 100));
      chunk.set_offset(offset);
      chunk.set_checksum(rpc::Checksum(chunk.data()));
      writer->Write(chunk);
    }
    return grpc::Status::OK;
  }
  void Note(const std::string& fetch) {
    absl::MutexLock lock(&mutex_);
    fetches_.push_back(fetch);
  }

  const Script script_;
  threads::Event answers_;
  absl::Mutex mutex_;
  std::vector<v1::Hello> hellos_;
  std::vector<std::string> fetches_;
  bool was_broken_ = false;
  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

void Welcome(WorkStream& stream, int64_t heartbeat_ms = 20) {
  v1::CoordinatorMessage message;
  message.mutable_welcome()->set_worker_id("w-7");
  message.mutable_welcome()->set_heartbeat_ms(heartbeat_ms);
  stream.Write(message);
}

/// The next message that is no heartbeat, or that is one; empty at the end of the stream.
v1::WorkerMessage Next(WorkStream& stream, bool is_heartbeat = false) {
  v1::WorkerMessage message;
  while (stream.Read(&message)) {
    if (message.has_heartbeat() == is_heartbeat) return message;
  }
  return {};
}

/// Lets a worker that leaves go: the stream ends from its side.
grpc::Status Release(WorkStream& stream, const std::string& reason) {
  EXPECT_EQ(Next(stream).leaving().reason(), reason);
  v1::CoordinatorMessage message;
  message.mutable_released();
  stream.Write(message);
  EXPECT_EQ(Next(stream).message_case(), v1::WorkerMessage::MESSAGE_NOT_SET);
  return grpc::Status::OK;
}

class ConnectionTest : public ::testing::Test {
 protected:
  ConnectionTest() {
    options_.name = "ann/1";
    options_.leave = &leave_;
  }
  absl::Status Run(const std::vector<std::string>& addresses) {
    return RunWorker(
        {.addresses = addresses,
         .connect = [](const std::string& address) -> absl::StatusOr<std::shared_ptr<grpc::Channel>> {
           if (address == "nowhere") return absl::InternalError("no such host");
           return rpc::MakeChannel(address, rpc::Security{});
         }},
        options_, stop_);
  }
  grpc::Status LeaveNow(WorkStream& stream) {
    Welcome(stream);
    EXPECT_TRUE(Next(stream, true).has_heartbeat()) << "it knows that it is welcome";
    leave_.Notify();
    return Release(stream, "signal");
  }

  WorkerOptions options_;
  threads::Event leave_, stop_;
  ScriptedCoordinator* coordinator_ = nullptr;
};

TEST_F(ConnectionTest, HelloSaysAllOfAWorker) {
  ScriptedCoordinator refusing(
      [](WorkStream&) { return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION, "old"); });
  options_.threads = 3;
  options_.tags = {"gpu", "night"};
  options_.memory_bytes = 4000;
  options_.finishing = {.count = 2, .memory_bytes = 5000};
  EXPECT_TRUE(absl::IsFailedPrecondition(Run({refusing.address()})));
  options_.renders = false;
  EXPECT_TRUE(absl::IsFailedPrecondition(Run({refusing.address()})));
  const std::vector<v1::Hello> hellos = refusing.hellos();
  ASSERT_THAT(hellos, SizeIs(2));
  EXPECT_EQ(hellos[0].name(), "ann/1");
  EXPECT_EQ(hellos[0].numeric_class(), render::NumericClass());
  EXPECT_EQ(hellos[0].slots(), 6);
  EXPECT_EQ(hellos[0].memory_bytes(), 4000u);
  EXPECT_EQ(hellos[0].wire_version(), rpc::kWireVersion);
  EXPECT_THAT(hellos[0].tags(), ElementsAre("gpu", "night"));
  EXPECT_NE(hellos[0].instance(), 0u);
  EXPECT_NE(hellos[0].instance(), hellos[1].instance()) << "each of its own";
  EXPECT_EQ(hellos[0].finishes(), 2);
  EXPECT_EQ(hellos[0].finish_memory_bytes(), 5000u);
  EXPECT_EQ(hellos[1].slots(), 0);
}

TEST_F(ConnectionTest, OneThatRefusesIsNoReasonToGiveUpWhereAnotherDoesNot) {
  ScriptedCoordinator refusing(
      [](WorkStream&) { return grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, "no"); });
  ScriptedCoordinator other([&](WorkStream& stream) { return LeaveNow(stream); });
  EXPECT_EQ(Run({"nowhere", refusing.address(), other.address()}), absl::OkStatus());
  EXPECT_THAT(refusing.hellos(), SizeIs(1));
  EXPECT_THAT(other.hellos(), SizeIs(1));
  EXPECT_EQ(refusing.hellos()[0].instance(), other.hellos()[0].instance());
}

TEST_F(ConnectionTest, RefusalsCountFromTheLastWelcome) {
  std::atomic<int> streams = 0;
  ScriptedCoordinator one(
      [&](WorkStream&) { return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION, "one"); });
  ScriptedCoordinator two([&](WorkStream& stream) {
    if (++streams == 1) {
      Welcome(stream);
      return grpc::Status(grpc::StatusCode::UNAVAILABLE, "it stops");
    }
    return grpc::Status(grpc::StatusCode::FAILED_PRECONDITION, "two");
  });
  const absl::Status status = Run({one.address(), two.address()});
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_EQ(status.message(), "two");
  EXPECT_THAT(one.hellos(), SizeIs(2));
}

TEST_F(ConnectionTest, RendersAUnitOfAJobThatItFetches) {
  ScriptedCoordinator coordinator([&](WorkStream& stream) {
    Welcome(stream);
    const v1::CoordinatorMessage grant = Grant(1);
    stream.Write(grant);
    // While the spec is not answered, heartbeats hold the lease.
    const v1::Heartbeat received = Next(stream, true).heartbeat();
    v1::Heartbeat heartbeat = received;
    for (int i = 0; i < 3 || heartbeat.newest_attempt() == 0; ++i) {
      heartbeat = Next(stream, true).heartbeat();
      if (heartbeat.ByteSizeLong() == 0) ADD_FAILURE() << "the stream has ended";
      if (heartbeat.ByteSizeLong() == 0) break;
    }
    EXPECT_EQ(heartbeat.held_size(), 1);
    EXPECT_EQ(heartbeat.newest_attempt(), 1);
    EXPECT_EQ(heartbeat.held(0).unit().job_id(), "j");
    coordinator_->AnswerSpecs();
    v1::WorkerMessage message = Next(stream);
    while (message.has_chunk() && !message.chunk().has_stats()) message = Next(stream);
    EXPECT_EQ(message.chunk().unit().job_id(), "j");
    EXPECT_EQ(message.chunk().attempt(), 1);
    EXPECT_EQ(message.chunk().stats().samples(), 16 * 16 * 2);
    stream.Write(Ack(grant.grant().leases(0)));
    v1::CoordinatorMessage drain;
    drain.mutable_drain()->set_finish_units(true);
    stream.Write(drain);
    return Release(stream, "drained");
  });
  coordinator_ = &coordinator;
  EXPECT_EQ(Run({coordinator.address()}), absl::OkStatus());
  EXPECT_THAT(coordinator.fetches(),
              ElementsAre("job_id: \"j\" worker_id: \"w-7\"", "j w-7 0 the scene", "j w-7 100 the scene"));
}

TEST_F(ConnectionTest, GoesWhereItIsSentWithWhatItHolds) {
  ScriptedCoordinator other([&](WorkStream& stream) { return LeaveNow(stream); });
  ScriptedCoordinator first([&](WorkStream& stream) {
    Welcome(stream);
    stream.Write(Grant(1));
    v1::CoordinatorMessage move;
    move.mutable_move()->set_address(other.address());
    stream.Write(move);
    const v1::WorkerMessage back = Next(stream);
    if (back.has_hand_back()) {  // no thread had begun it
      EXPECT_EQ(back.hand_back().leases_size(), 1);
    } else {
      stream.Write(Ack(Grant(1).grant().leases(0)));
    }
    while (Next(stream).message_case() != v1::WorkerMessage::MESSAGE_NOT_SET) {
    }
    return grpc::Status::OK;
  });
  first.AnswerSpecs();
  EXPECT_EQ(Run({first.address()}), absl::OkStatus());
  EXPECT_FALSE(first.was_broken() || other.was_broken());
  ASSERT_THAT(other.hellos(), SizeIs(1));
  EXPECT_EQ(other.hellos()[0].instance(), first.hellos()[0].instance());
}

TEST_F(ConnectionTest, AWorkerThatRestsHandsBackWhatItGetsAndSaysWhenItWorksAgain) {
  std::atomic<bool> rests = true;
  options_.rest_reason = [&] { return std::string(rests ? "off hours" : ""); };
  ScriptedCoordinator coordinator([&](WorkStream& stream) {
    EXPECT_EQ(Next(stream).rest().reason(), "off hours") << "before it is welcome";
    Welcome(stream);
    stream.Write(Grant(2));
    EXPECT_EQ(Next(stream).hand_back().leases_size(), 2);
    rests = false;
    const v1::WorkerMessage message = Next(stream);
    EXPECT_TRUE(message.has_rest());
    EXPECT_EQ(message.rest().reason(), "");
    leave_.Notify();
    return Release(stream, "signal");
  });
  EXPECT_EQ(Run({coordinator.address()}), absl::OkStatus());
}

TEST_F(ConnectionTest, AnIdleWorkerThatReachesNobodyLeaves) {
  options_.exit_when_idle = absl::Milliseconds(200);
  const absl::Status status = Run({"nowhere"});
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  EXPECT_THAT(status.message(), HasSubstr("reached no coordinator within 200ms"));
}

TEST_F(ConnectionTest, AStopBreaksTheStreamAndAnIdentityThatHasExpiredBeginsNone) {
  ScriptedCoordinator coordinator([&](WorkStream& stream) {
    Welcome(stream);
    stop_.Notify();
    while (Next(stream).message_case() != v1::WorkerMessage::MESSAGE_NOT_SET) {
    }
    return grpc::Status::OK;
  });
  EXPECT_EQ(Run({coordinator.address()}), absl::OkStatus());
  threads::Event never;
  options_.check_identity = [] { return absl::UnauthenticatedError("it has expired"); };
  EXPECT_TRUE(absl::IsUnauthenticated(
      RunWorker({.addresses = {coordinator.address()}, .connect = nullptr}, options_, never)));
  EXPECT_THAT(coordinator.hellos(), SizeIs(1));
}

}  // namespace
}  // namespace lumifold::worker
