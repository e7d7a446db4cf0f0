// Connections of a coordinator: where it listens, who is disconnected, and how streams end.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/version.h"
#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

class ConnectionsTest : public FarmFixture {};

TEST_F(ConnectionsTest, AWorkerThatDoesNotReadIsDisconnected) {
  const auto stub = v1::WorkerService::NewStub(Channel());
  grpc::ClientContext context;
  const auto stream = stub->Work(&context);
  v1::WorkerMessage message;
  message.mutable_hello()->set_numeric_class("test");
  message.mutable_hello()->set_slots(1);
  message.mutable_hello()->set_wire_version(rpc::kWireVersion);
  ASSERT_TRUE(stream->Write(message));
  // Each of these is answered by an acknowledgement of about the same size.
  message.mutable_chunk()->mutable_unit()->set_job_id(std::string(1000, 'x'));
  message.mutable_chunk()->mutable_pixels()->set_last(true);
  int written = 0;
  while (written < 100'000 && stream->Write(message)) ++written;
  EXPECT_LT(written, 50'000) << "nobody stops it";
  v1::CoordinatorMessage ignored;
  while (stream->Read(&ignored)) {
  }
  EXPECT_FALSE(stream->Finish().ok());
}

TEST_F(ConnectionsTest, ASlowWatcherSkipsStatesButGetsTheLast) {
  StopServer();
  ServerOptions options = Options();
  options.lease = absl::Hours(10'000);
  options.limits.calls.stalled_stream = absl::InfiniteDuration();
  // Every change is due at once, however fast they come; the clock does not get as far as to void a lease.
  const auto ticks = std::make_shared<std::atomic<int64_t>>(0);
  options.now = [ticks] { return absl::UnixEpoch() + absl::Milliseconds(100) * ticks->fetch_add(1); };
  StartServer(options);
  v1::JobSpec spec = Spec();
  spec.set_frame_count(10);
  const std::string job = *Submit(spec);
  // What a connection takes before the watcher reads would grow with its speed, to half of the states and
  // more.
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 1 << 16);
  const auto stub = v1::FarmService::NewStub(grpc::CreateCustomChannel(
      absl::StrCat("127.0.0.1:", server_->port()), grpc::InsecureChannelCredentials(), arguments));
  grpc::ClientContext context;
  v1::WatchJobRequest request;
  request.set_job_id(job);
  const auto watch = stub->WatchJob(&context, request);
  v1::JobStatus status;
  ASSERT_TRUE(watch->Read(&status));
  // A status grows to 50 KiB.
  const auto worker = Worker({.slots = 1, .spoil = [](v1::WorkerMessage& message) {
                                if (!message.chunk().has_stats()) return;
                                for (int i = 0; i < 32; ++i) {
                                  message.mutable_chunk()->mutable_stats()->add_warnings(absl::StrCat(
                                      message.chunk().unit().tile(), " ", i, std::string(500, 'x')));
                                }
                              }});
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  int read = 0;
  while (watch->Read(&status)) ++read;
  EXPECT_LT(read, 5 * kUnits) << "of twice as many states";
  EXPECT_EQ(status.state(), v1::JOB_STATE_DONE);
}

TEST_F(ConnectionsTest, StopsPromptlyWithStreamsOpen) {
  const std::string job = *Submit(Spec());
  const auto worker = Worker({.numeric_class = "other", .slots = 1, .vanish_after = 0});
  const auto idle = Worker({.slots = 1, .spoil = [](v1::WorkerMessage& message) {
                              if (message.has_chunk()) message.mutable_chunk()->set_attempt(0);
                            }});
  WaitUntil(job, [](const v1::JobStatus& status) { return status.state() == v1::JOB_STATE_RUNNING; });
  const absl::Time start = absl::Now();
  StopServer();
  EXPECT_LT(absl::Now() - start, absl::Minutes(1))
      << "streams that stay open hold it up until their deadline";
  idle->Wait();
}

TEST_F(ConnectionsTest, ATakenPortIsNamed) {
  ServerOptions options = Options();
  options.data.folder = folder_.PathOf("other");
  options.listen = "127.0.0.1:" + std::to_string(server_->port());
  const absl::Status status = Server::Start(options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(options.listen));
}

TEST_F(ConnectionsTest, OffLoopbackIsClosedByDefault) {
  ServerOptions options = Options();
  options.data.folder = folder_.PathOf("other");
  options.listen = "0.0.0.0:0";
  EXPECT_EQ(Server::Start(options).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(std::filesystem::exists(options.data.folder));
}

TEST_F(ConnectionsTest, AConnectionWithoutACallIsClosed) {
  StopServer();
  ServerOptions options = Options();
  options.limits.connections.idle_connection = absl::Milliseconds(100);
  StartServer(options);
  const rpc::FileHandle connected(socket(AF_INET, SOCK_STREAM, 0));
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(server_->port()));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(connect(connected.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  // HTTP/2's preface and an empty frame of settings: a client that is well but wants nothing.
  const std::string hello("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\4\0\0\0\0\0", 33);
  ASSERT_EQ(send(connected.get(), hello.data(), hello.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(hello.size()));
  char buffer[256];
  while (recv(connected.get(), buffer, sizeof buffer, 0) > 0) {
  }
}

}  // namespace
}  // namespace lumifold::server
