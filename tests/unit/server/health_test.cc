#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/net/health_check.h"
#include "tests/unit/server/farm_fixture.h"
#include "tests/unit/server/faulty_files.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

constexpr char kWatch[] = "/grpc.health.v1.Health/Watch";
constexpr char kReflect[] = "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo";

/// A string field of a message, encoded. Its number is below 16 and its length below 128.
std::string StringField(int number, const std::string& value) {
  return std::string{static_cast<char>(number << 3 | 2), static_cast<char>(value.size())} + value;
}

/// Responses of the health service, encoded: field 1 is the status.
const std::string kServing = "\x08\x01";
const std::string kNotServing = "\x08\x02";
const std::string kServiceUnknown = "\x08\x03";

/// A call that sends one message and receives several, without generated code: services that every gRPC
/// client may call are called by their names.
class GenericStream {
 public:
  GenericStream(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                const std::string& request)
      : stub_(channel) {
    context_.set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(10));
    call_ = stub_.PrepareCall(&context_, method, &queue_);
    call_->StartCall(nullptr);
    EXPECT_TRUE(Wait());
    const grpc::Slice slice(request);
    call_->WriteLast(grpc::ByteBuffer(&slice, 1), {}, nullptr);
    EXPECT_TRUE(Wait());
  }
  ~GenericStream() {
    context_.TryCancel();
    grpc::Status status;
    call_->Finish(&status, nullptr);
    Wait();
  }

  /// The next message; "end" after the last.
  std::string Next() {
    grpc::ByteBuffer buffer;
    call_->Read(&buffer, nullptr);
    if (!Wait()) return "end";
    grpc::Slice slice;
    EXPECT_TRUE(buffer.DumpToSingleSlice(&slice).ok());
    return {reinterpret_cast<const char*>(slice.begin()), slice.size()};
  }

 private:
  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    return queue_.Next(&tag, &ok) && ok;
  }

  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
};

using HealthTest = FarmFixture;

TEST_F(HealthTest, EachServiceIsServingUntilTheServerStops) {
  const auto channel = Channel();
  GenericStream all(channel, kWatch, "");
  GenericStream farm(channel, kWatch, StringField(1, "lumifold.v1.FarmService"));
  GenericStream worker(channel, kWatch, StringField(1, "lumifold.v1.WorkerService"));
  GenericStream other(channel, kWatch, StringField(1, "lumifold.v1.Unknown"));
  for (GenericStream* stream : {&all, &farm, &worker}) EXPECT_EQ(stream->Next(), kServing);
  EXPECT_EQ(other.Next(), kServiceUnknown);
  StopServer();
  for (GenericStream* stream : {&all, &farm, &worker}) EXPECT_EQ(stream->Next(), kNotServing);
}

TEST_F(HealthTest, IsNotServingWhileTheStorageCannotBeWritten) {
  StopServer();
  FaultyFiles files;
  ServerOptions options = Options();
  options.data.files = &files;
  options.data.storage.pauses.first = absl::Milliseconds(10);
  StartServer(options);
  const v1::JobSpec spec = Spec();
  GenericStream farm(Channel(), kWatch, StringField(1, "lumifold.v1.FarmService"));
  EXPECT_EQ(farm.Next(), kServing);
  files.Fail(ENOSPC);
  EXPECT_EQ(Submit(spec).status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(farm.Next(), kNotServing);
  files.Heal();
  EXPECT_EQ(farm.Next(), kServing);
  EXPECT_TRUE(Submit(spec).ok());
  StopServer();
}

TEST_F(HealthTest, TheCommandTellsServingFromAnsweringFromNothing) {
  StopServer();
  FaultyFiles files;
  ServerOptions options = Options();
  options.data.files = &files;
  options.data.storage.pauses.longest = absl::Milliseconds(10);
  StartServer(options);
  HealthCheckOptions check{.address = absl::StrCat("127.0.0.1:", server_->port())};
  HealthCheckOptions answers = check;
  answers.answers_only = true;
  EXPECT_TRUE(CheckHealth(check).ok());
  const v1::JobSpec spec = Spec();
  files.Fail(ENOSPC);
  EXPECT_FALSE(Submit(spec).ok());
  EXPECT_THAT(std::string(CheckHealth(check).message()), HasSubstr("does not serve"));
  EXPECT_TRUE(CheckHealth(answers).ok());
  files.Heal();
  StopServer();
  EXPECT_THAT(std::string(CheckHealth(check).message()), HasSubstr("does not answer"));
  EXPECT_FALSE(CheckHealth(answers).ok());
}

TEST_F(HealthTest, ReflectionNamesTheServicesAndDescribesThem) {
  GenericStream list(Channel(), kReflect, StringField(7, ""));
  const std::string services = list.Next();
  for (const char* name : {"lumifold.v1.FarmService", "lumifold.v1.WorkerService", "grpc.health.v1.Health"})
    EXPECT_THAT(services, HasSubstr(name));
  GenericStream symbol(Channel(), kReflect, StringField(4, "lumifold.v1.FarmService"));
  const std::string file = symbol.Next();
  for (const char* name : {"lumifold/v1/farm.proto", "SubmitJob", "ExplainJob"})
    EXPECT_THAT(file, HasSubstr(name));
}

}  // namespace
}  // namespace lumifold::server
