// Every call of the coordinator's services, from raw bytes: they pass through gRPC, its parsing of messages,
// the adapter and the coordinator, as from a client that sends what it likes. An input is a method and
// messages; those of a worker's stream come after one another.

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <random>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/stubs/logging.h"
#include "lumifold/v1/access.grpc.pb.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/version.h"
#include "server/access/access_control.h"
#include "server/server.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/made_up_plan.h"
#include "tests/support/temp_folder.h"

namespace lumifold::fuzz {
namespace {

constexpr char kScene[] = "a scene nobody reads";
/// Calls after which a new coordinator is made: its jobs would make each call slower.
constexpr int kCallsOfAFarm = 2000;
/// A call that streams has no end of its own.
constexpr absl::Duration kStreamTime = absl::Milliseconds(20);
constexpr absl::Duration kCallTime = absl::Seconds(10);
constexpr int kMaxReplies = 32;

struct Method {
  std::string path;
  bool takes_stream = false;
  bool streams = false;  // in either direction
};

/// The methods of all services that the protocol has, in the order of its files.
const std::vector<Method>& Methods() {
  static const std::vector<Method> methods = [] {
    std::vector<Method> all;
    for (const google::protobuf::FileDescriptor* file :
         {v1::SubmitJobRequest::descriptor()->file(), v1::WorkerMessage::descriptor()->file(),
          v1::LoginRequest::descriptor()->file()}) {
      for (int s = 0; s < file->service_count(); ++s) {
        for (int m = 0; m < file->service(s)->method_count(); ++m) {
          const google::protobuf::MethodDescriptor& method = *file->service(s)->method(m);
          all.push_back({.path = absl::StrCat("/", file->service(s)->full_name(), "/", method.name()),
                         .takes_stream = method.client_streaming(),
                         .streams = method.client_streaming() || method.server_streaming()});
        }
      }
    }
    return all;
  }();
  return methods;
}

uint8_t NumberOf(const std::string& name) {
  for (size_t i = 0; i < Methods().size(); ++i) {
    if (Methods()[i].path.ends_with("/" + name)) return static_cast<uint8_t>(i);
  }
  Fail("no method", name);
}

std::string Call(const std::string& method, const std::vector<std::string>& messages) {
  const uint8_t number = NumberOf(method);
  return static_cast<char>(number) + (Methods()[number].takes_stream ? Joined(messages) : messages.front());
}

/// A coordinator in memory with one job. Equal for all runs: jobs have the same ids.
class Farm {
 public:
  Farm() : folder_(InMemory()) {
    server::ServerOptions options;
    options.data.folder = folder_.PathOf("data");
    // Access control is there for a coordinator that listens, but all calls come from inside the process.
    options.listen = "127.0.0.1:0";
    if (!std::filesystem::create_directory(options.data.folder)) Fail("no folder", options.data.folder);
    if (const absl::Status made = access::MakeAccessFolder(
            {.folder = options.data.folder + "/access", .store = "", .log = nullptr}, {});
        !made.ok())
      Fail("no access control", std::string(made.message()));
    options.data.storage.reserve_bytes = 0;
    options.random = [random = std::make_shared<std::mt19937_64>(1)] { return (*random)(); };
    absl::StatusOr<std::unique_ptr<server::Server>> server = server::Server::Start(std::move(options));
    if (!server.ok()) Fail("no server", std::string(server.status().message()));
    server_ = *std::move(server);
    stub_ = std::make_unique<grpc::GenericStub>(server_->InProcessChannel());
    for (const std::vector<std::string>& call : {UploadOfTheScene(), Submission()}) Make(call);
  }
  ~Farm() {
    stub_ = nullptr;
    server_->Shutdown();
  }

  const std::string& job_id() const { return job_id_; }

  /// Makes the call of an input. Whatever it says, the answer is a reply or an error in words.
  void Try(std::string_view input) {
    if (input.empty()) return;
    const Method& method = Methods()[static_cast<uint8_t>(input[0]) % Methods().size()];
    const std::vector<std::string> messages = method.takes_stream
                                                  ? Pieces(input.substr(1))
                                                  : std::vector<std::string>{std::string(input.substr(1))};
    const grpc::Status status = Run(method, messages, nullptr);
    if (!method.streams && status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED)
      Fail(method.path.c_str(), "no answer");
    if (status.error_code() == grpc::StatusCode::UNKNOWN ||
        status.error_message().size() > 4 * rpc::kMaxErrorBytes)
      Fail(method.path.c_str(), status.error_message());
  }

  static std::string Asset() {
    v1::AssetRef asset;
    asset.set_sha256(rpc::Sha256Hex(kScene));
    asset.set_size(sizeof(kScene) - 1);
    return asset.SerializeAsString();
  }

  static std::vector<std::string> UploadOfTheScene() {
    v1::UploadAssetRequest announcement;
    announcement.mutable_announce()->ParseFromString(Asset());
    v1::UploadAssetRequest content;
    content.mutable_chunk()->set_data(kScene);
    content.mutable_chunk()->set_checksum(rpc::Checksum(kScene));
    content.mutable_chunk()->set_total_size(sizeof(kScene) - 1);
    return {"UploadAsset", announcement.SerializeAsString(), content.SerializeAsString()};
  }

  static std::vector<std::string> Submission() {
    v1::SubmitJobRequest request;
    request.set_request_id("r-1");
    v1::JobSpec* spec = request.mutable_spec();
    spec->mutable_scene()->mutable_file()->ParseFromString(Asset());
    spec->mutable_scene()->set_display_name("made-up.glb");
    spec->set_width(20);
    spec->set_height(12);
    spec->set_samples_per_pixel(10);
    spec->mutable_planning()->add_forced("glossy=off");
    spec->set_frame_count(2);
    spec->set_max_bounces(8);
    spec->mutable_filter()->set_method("none");
    request.mutable_scheduling()->set_user("ann");
    return {"SubmitJob", request.SerializeAsString()};
  }

 private:
  /// A valid call: its name and messages.
  void Make(std::vector<std::string> call) {
    const Method& method = Methods()[NumberOf(call.front())];
    call.erase(call.begin());
    std::string reply;
    const grpc::Status status = Run(method, call, &reply);
    if (!status.ok()) Fail(method.path.c_str(), status.error_message());
    v1::SubmitJobResponse response;
    if (method.path.ends_with("SubmitJob") && response.ParseFromString(reply)) job_id_ = response.job_id();
  }

  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    return queue_.Next(&tag, &ok) && ok;
  }

  /// With `reply`, a call that is expected to end by itself.
  grpc::Status Run(const Method& method, const std::vector<std::string>& messages, std::string* reply) {
    grpc::ClientContext context;
    context.set_deadline(
        absl::ToChronoTime(absl::Now() + (method.streams && reply == nullptr ? kStreamTime : kCallTime)));
    const std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call =
        stub_->PrepareCall(&context, method.path, &queue_);
    call->StartCall(nullptr);
    bool open = Wait();
    for (size_t i = 0; i < messages.size() && open; ++i) {
      const grpc::Slice slice(messages[i]);
      call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
      open = Wait();
    }
    call->WritesDone(nullptr);
    Wait();
    grpc::ByteBuffer answer;
    for (int i = 0; i < kMaxReplies; ++i) {
      call->Read(&answer, nullptr);
      if (!Wait()) break;
      grpc::Slice slice;
      if (reply != nullptr && answer.DumpToSingleSlice(&slice).ok())
        reply->assign(reinterpret_cast<const char*>(slice.begin()), slice.size());
    }
    grpc::Status status;
    if (method.streams && reply == nullptr) context.TryCancel();
    call->Finish(&status, nullptr);
    Wait();
    return status;
  }

  TempFolder folder_;
  std::unique_ptr<server::Server> server_;
  std::unique_ptr<grpc::GenericStub> stub_;
  grpc::CompletionQueue queue_;
  std::string job_id_;
};

/// The messages of a worker that joins, delivers, fails, hands back, plans and leaves.
std::vector<std::string> WorkerMessages(const std::string& job_id) {
  std::vector<v1::WorkerMessage> messages(7);
  v1::Hello* hello = messages[0].mutable_hello();
  hello->set_name("fuzz");
  hello->set_numeric_class("lumifold/any");
  hello->set_slots(2);
  hello->set_wire_version(rpc::kWireVersion);
  hello->add_tags("gpu");
  v1::UnitId unit;
  unit.set_job_id(job_id);
  unit.set_kind(v1::UNIT_KIND_PASS);
  messages[1].mutable_heartbeat()->add_held()->set_attempt(1);
  *messages[1].mutable_heartbeat()->mutable_held(0)->mutable_unit() = unit;
  messages[1].mutable_heartbeat()->set_newest_attempt(1);
  v1::LogEvent* line = messages[1].mutable_heartbeat()->add_log();
  line->set_unix_ms(1);
  line->set_level("warn");
  line->set_text("event=unit_failed job=" + job_id + " error=\"made up\"");
  v1::UnitChunk* chunk = messages[2].mutable_chunk();
  *chunk->mutable_unit() = unit;
  chunk->set_attempt(1);
  chunk->mutable_pixels()->mutable_layout()->set_width(8);
  chunk->mutable_pixels()->mutable_layout()->set_height(8);
  chunk->mutable_pixels()->mutable_layout()->add_channels("noisy_a.R");
  chunk->mutable_pixels()->set_data(std::string(256, 'x'));
  chunk->mutable_pixels()->set_checksum(rpc::Checksum(chunk->pixels().data()));
  chunk->mutable_stats()->set_samples(4);
  *messages[3].mutable_failure()->mutable_unit() = unit;
  messages[3].mutable_failure()->set_attempt(1);
  messages[3].mutable_failure()->set_error("made up");
  *messages[3].mutable_failure()->add_log() = *line;
  messages[3].mutable_failure()->mutable_missing_asset()->ParseFromString(Farm::Asset());
  *messages[4].mutable_hand_back()->add_leases() = messages[1].heartbeat().held(0);
  unit.set_kind(v1::UNIT_KIND_PLAN);
  *messages[5].mutable_plan()->mutable_unit() = unit;
  messages[5].mutable_plan()->set_attempt(1);
  *messages[5].mutable_plan()->mutable_plan() = MadeUpPlan();
  messages[6].mutable_leaving()->set_reason("signal");
  std::vector<std::string> bytes;
  bytes.reserve(messages.size());
  for (const v1::WorkerMessage& message : messages) bytes.push_back(message.SerializeAsString());
  return bytes;
}

}  // namespace

std::vector<std::string> Seeds() {
  google::protobuf::SetLogHandler(nullptr);  // it would print a line for each malformed message
  const Farm farm;
  const std::string& job = farm.job_id();
  std::vector<std::string> seeds;
  // Most requests begin with the id of a job; the others are seeds of their own.
  for (const Method& method : Methods()) {
    const std::string name = method.path.substr(method.path.rfind('/') + 1);
    v1::GetJobRequest request;
    request.set_job_id(job);
    seeds.push_back(Call(name, {request.SerializeAsString()}));
    seeds.push_back(Call(name, {""}));
  }
  for (std::vector<std::string> call : {Farm::UploadOfTheScene(), Farm::Submission()}) {
    const std::string name = call.front();
    call.erase(call.begin());
    seeds.push_back(Call(name, call));
  }
  const std::vector<std::string> messages = WorkerMessages(job);
  seeds.push_back(Call("Work", messages));
  for (size_t i = 1; i < messages.size(); ++i) seeds.push_back(Call("Work", {messages[0], messages[i]}));
  v1::FindMissingAssetsRequest find;
  find.add_assets()->ParseFromString(Farm::Asset());
  seeds.push_back(Call("FindMissingAssets", {find.SerializeAsString()}));
  v1::FetchAssetRequest fetch;
  fetch.set_sha256(rpc::Sha256Hex(kScene));
  fetch.set_worker_id("w-1");
  fetch.set_job_id(job);
  seeds.push_back(Call("FetchAsset", {fetch.SerializeAsString()}));
  v1::FetchUnitsRequest units;
  units.set_worker_id("w-1");
  units.mutable_unit()->set_job_id(job);
  units.mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
  units.set_attempt(1);
  seeds.push_back(Call("FetchUnits", {units.SerializeAsString()}));
  v1::DeliverResultRequest result;
  result.mutable_announce()->set_worker_id("w-1");
  *result.mutable_announce()->mutable_unit() = units.unit();
  result.mutable_announce()->set_attempt(1);
  v1::DeliverResultRequest bytes_of_result;
  bytes_of_result.mutable_chunk()->set_data(kScene);
  bytes_of_result.mutable_chunk()->set_checksum(rpc::Checksum(kScene));
  bytes_of_result.mutable_chunk()->set_total_size(sizeof(kScene) - 1);
  bytes_of_result.mutable_chunk()->set_sha256(rpc::Sha256Hex(kScene));
  seeds.push_back(Call("DeliverResult", {result.SerializeAsString(), bytes_of_result.SerializeAsString()}));
  v1::RetryJobRequest retry;
  retry.set_job_id(job);
  retry.mutable_region()->set_x1(8);
  retry.mutable_region()->set_y1(8);
  seeds.push_back(Call("RetryJob", {retry.SerializeAsString()}));
  retry.clear_region();
  retry.set_skip(true);
  seeds.push_back(Call("RetryJob", {retry.SerializeAsString()}));
  v1::AddSamplesRequest add;
  add.set_job_id(job);
  add.set_samples_per_pixel(20);
  seeds.push_back(Call("AddSamples", {add.SerializeAsString()}));
  v1::SetJobPriorityRequest priority;
  priority.set_job_id(job);
  priority.set_priority(10);
  seeds.push_back(Call("SetJobPriority", {priority.SerializeAsString()}));
  priority.set_to_front(true);
  seeds.push_back(Call("SetJobPriority", {priority.SerializeAsString()}));
  v1::WorkerRequest worker;
  worker.set_worker("fuzz");
  worker.set_reason("made up");
  for (const char* name : {"DrainWorker", "BlockWorker", "ReadmitWorker"})
    seeds.push_back(Call(name, {worker.SerializeAsString()}));
  v1::ListJobsRequest list;
  list.set_limit(10);
  seeds.push_back(Call("ListJobs", {list.SerializeAsString()}));
  v1::GetUsageRequest usage;
  usage.set_since_unix_ms(1);
  usage.set_user("fuzz");
  seeds.push_back(Call("GetUsage", {usage.SerializeAsString()}));
  return seeds;
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using lumifold::fuzz::Farm;
  using lumifold::fuzz::kCallsOfAFarm;
  static std::unique_ptr<Farm> farm;
  static int calls = 0;
  if (farm == nullptr || ++calls % kCallsOfAFarm == 0) {
    farm = nullptr;
    farm = std::make_unique<Farm>();
  }
  farm->Try({reinterpret_cast<const char*>(data), size});
  return 0;
}
