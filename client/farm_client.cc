#include "client/farm_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/exit_code.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::client {
namespace {

// Short calls: few tries with short pauses, so that the user soon sees the error of a wrong address.
const rpc::RetryPolicy kCallPolicy = {
    .try_timeout = absl::Seconds(10), .total_timeout = absl::Seconds(20), .max_tries = 3};
const rpc::RetryPolicy kSlowCallPolicy = {
    .try_timeout = absl::Seconds(30), .total_timeout = absl::Seconds(60), .max_tries = 3};
// For calls that must not be repeated when it is unknown whether they took effect.
const rpc::RetryPolicy kOncePolicy = {.try_timeout = absl::Seconds(30), .max_tries = 1};
// Streams have longer deadlines than calls. The callers reopen a stream that broke or exceeded its deadline.
constexpr absl::Duration kStreamTimeout = absl::Minutes(10);
// Uploads over slower connections exceed their deadline and go on with a new call.
constexpr double kSlowestUploadBytesPerSecond = 128 * 1024;
// The coordinator reads assets that it has not used since its start. It manages 1.5 GB/s; a busy disk a tenth of that.
constexpr double kSlowestCheckBytesPerSecond = 150e6;
constexpr absl::Duration kTick = absl::Milliseconds(100);

/// Policy of a call for which the coordinator may have to read all files of a scene.
rpc::RetryPolicy PolicyFor(const v1::SceneRef& scene) {
  double bytes = static_cast<double>(scene.file().size());
  for (const v1::AssetRef& asset : scene.dependencies()) bytes += static_cast<double>(asset.size());
  rpc::RetryPolicy policy = kSlowCallPolicy;
  policy.try_timeout += absl::Seconds(bytes / kSlowestCheckBytesPerSecond);
  policy.total_timeout += absl::Seconds(bytes / kSlowestCheckBytesPerSecond);
  return policy;
}

class GrpcFarmClient : public FarmClient {
  using Stub = v1::FarmService::Stub;

 public:
  GrpcFarmClient(std::shared_ptr<grpc::Channel> channel, FarmClientOptions options)
      : stub_(v1::FarmService::NewStub(std::move(channel))), options_(std::move(options)) {}

  absl::StatusOr<std::vector<std::string>> FindMissingAssets(const v1::SceneRef& scene) override {
    v1::FindMissingAssetsRequest request;
    *request.add_assets() = scene.file();
    for (const v1::AssetRef& asset : scene.dependencies()) *request.add_assets() = asset;
    const absl::StatusOr<v1::FindMissingAssetsResponse> response =
        Unary<v1::FindMissingAssetsResponse>(PolicyFor(scene), &Stub::FindMissingAssets, request);
    if (!response.ok()) return response.status();
    return std::vector<std::string>(response->missing_sha256().begin(), response->missing_sha256().end());
  }

  absl::StatusOr<uint64_t> FindUpload(const v1::AssetRef& asset) override {
    v1::FindUploadRequest request;
    *request.mutable_asset() = asset;
    const absl::StatusOr<v1::FindUploadResponse> response =
        Unary<v1::FindUploadResponse>(kSlowCallPolicy, &Stub::FindUpload, request);
    if (!response.ok()) return response.status();
    return std::min<uint64_t>(response->received_bytes(), asset.size());
  }

  absl::Status UploadAsset(const LocalAsset& asset, uint64_t offset,
                           absl::FunctionRef<void(uint64_t)> on_sent) override {
    grpc::ClientContext context;
    const double slowest = static_cast<double>(asset.ref.size() - offset) / kSlowestUploadBytesPerSecond;
    context.set_deadline(rpc::MonotonicDeadline(kSlowCallPolicy.try_timeout + absl::Seconds(slowest)));
    return UploadOnce(context, asset, offset, on_sent);
  }

  absl::StatusOr<std::string> SubmitJob(const v1::SubmitJobRequest& request) override {
    const absl::StatusOr<v1::SubmitJobResponse> response =
        Unary<v1::SubmitJobResponse>(kSlowCallPolicy, &Stub::SubmitJob, request);
    if (!response.ok()) return response.status();
    return response->job_id();
  }

  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kCallPolicy, &Stub::GetJob, OfJob<v1::GetJobRequest>(job_id));
  }
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request) override {
    return Unary<v1::ListJobsResponse>(kCallPolicy, &Stub::ListJobs, request);
  }
  absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kCallPolicy, &Stub::CancelJob, OfJob<v1::CancelJobRequest>(job_id));
  }
  absl::StatusOr<v1::JobStatus> PauseJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kCallPolicy, &Stub::PauseJob, OfJob<v1::PauseJobRequest>(job_id));
  }
  absl::StatusOr<v1::JobStatus> ResumeJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kCallPolicy, &Stub::ResumeJob, OfJob<v1::ResumeJobRequest>(job_id));
  }
  absl::StatusOr<v1::JobStatus> SetJobPriority(const std::string& job_id, int priority) override {
    auto request = OfJob<v1::SetJobPriorityRequest>(job_id);
    request.set_priority(priority);
    return Unary<v1::JobStatus>(kCallPolicy, &Stub::SetJobPriority, request);
  }
  absl::Status DeleteJob(const std::string& job_id) override {
    return Unary<v1::DeleteJobResponse>(kCallPolicy, &Stub::DeleteJob, OfJob<v1::DeleteJobRequest>(job_id))
        .status();
  }
  absl::StatusOr<v1::JobStatus> RetryJob(const v1::RetryJobRequest& request) override {
    return Unary<v1::JobStatus>(kOncePolicy, &Stub::RetryJob, request);
  }
  absl::StatusOr<v1::JobStatus> AddSamples(const std::string& job_id, int samples_per_pixel) override {
    auto request = OfJob<v1::AddSamplesRequest>(job_id);
    request.set_samples_per_pixel(samples_per_pixel);
    return Unary<v1::JobStatus>(kSlowCallPolicy, &Stub::AddSamples, request);
  }
  absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id) override {
    return Unary<v1::ExplainJobResponse>(kCallPolicy, &Stub::ExplainJob,
                                         OfJob<v1::ExplainJobRequest>(job_id));
  }

  absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request) override {
    return Unary<v1::ListWorkersResponse>(kCallPolicy, &Stub::ListWorkers, request);
  }
  absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kCallPolicy, &Stub::DrainWorker, request);
  }
  absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kCallPolicy, &Stub::BlockWorker, request);
  }
  absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kCallPolicy, &Stub::ReadmitWorker, request);
  }
  absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request) override {
    return Unary<v1::GetLogResponse>(kCallPolicy, &Stub::GetLog, request);
  }
  absl::StatusOr<v1::ServerStatus> GetServerStatus() override {
    return Unary<v1::ServerStatus>(kCallPolicy, &Stub::GetServerStatus, v1::GetServerStatusRequest());
  }

  absl::Status WatchJob(const std::string& job_id, absl::FunctionRef<void(const v1::JobStatus&)> on_status,
                        absl::FunctionRef<void()> on_tick) override {
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    grpc::ClientContext context;
    context.set_deadline(rpc::MonotonicDeadline(kStreamTimeout));
    grpc::CompletionQueue queue;
    const auto reader = stub_->AsyncWatchJob(&context, request, &queue, nullptr);
    v1::JobStatus job;
    bool more = Wait(queue, context, on_tick);
    while (more) {
      reader->Read(&job, nullptr);
      more = Wait(queue, context, on_tick);
      if (more) on_status(job);
    }
    grpc::Status status;
    reader->Finish(&status, nullptr);
    Wait(queue, context, on_tick);
    return StatusOfCall(status);
  }

  absl::Status DownloadResult(const std::string& job_id, int frame, uint64_t offset,
                              absl::FunctionRef<absl::Status(const v1::ByteChunk&)> on_chunk) override {
    v1::DownloadResultRequest request;
    request.set_job_id(job_id);
    request.set_frame(frame);
    request.set_offset(offset);
    grpc::ClientContext context;
    context.set_deadline(rpc::MonotonicDeadline(kStreamTimeout));
    const auto reader = stub_->DownloadResult(&context, request);
    absl::Status taken;
    v1::ByteChunk chunk;
    while (taken.ok() && !options_.interrupted() && reader->Read(&chunk)) taken = on_chunk(chunk);
    if (!taken.ok() || options_.interrupted()) context.TryCancel();
    const absl::Status status = StatusOfCall(reader->Finish());
    return taken.ok() ? status : taken;
  }

 private:
  // Waits for the pending operation. False when it failed, also at the end of the stream or when the user
  // interrupts.
  bool Wait(grpc::CompletionQueue& queue, grpc::ClientContext& context,
            absl::FunctionRef<void()> on_tick) const {
    void* tag = nullptr;
    bool ok = false;
    while (queue.AsyncNext(&tag, &ok, rpc::MonotonicDeadline(kTick)) == grpc::CompletionQueue::TIMEOUT) {
      if (options_.interrupted()) context.TryCancel();
      on_tick();
    }
    return ok;
  }

  template <typename Request>
  static Request OfJob(const std::string& job_id) {
    Request request;
    request.set_job_id(job_id);
    return request;
  }

  // A call with one request and one response, repeated as the policy says.
  template <typename Response, typename Request>
  absl::StatusOr<Response> Unary(const rpc::RetryPolicy& policy,
                                 grpc::Status (Stub::*call)(grpc::ClientContext*, const Request&, Response*),
                                 const Request& request) const {
    Response response;
    absl::Status status = rpc::CallWithRetry(
        policy, rpc::Idempotency::kIdempotent, options_.time, [&](grpc::ClientContext& context) {
          return StatusOfCall((stub_.get()->*call)(&context, request, &response));
        });
    if (!status.ok()) return status;
    return response;
  }

  absl::Status UploadOnce(grpc::ClientContext& context, const LocalAsset& asset, uint64_t offset,
                          absl::FunctionRef<void(uint64_t)> on_sent) const {
    absl::StatusOr<rpc::FileHandle> file = OpenAsset(asset);
    if (!file.ok()) return OfThisMachine(file.status());
    absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::OfFile(*std::move(file), asset.path, offset);
    if (!sender.ok()) return OfThisMachine(sender.status());
    v1::UploadAssetResponse response;
    const auto writer = stub_->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_announce() = asset.ref;
    bool open = writer->Write(request);
    absl::StatusOr<bool> more = true;
    while (open && !options_.interrupted()) {
      more = sender->Next(request.mutable_chunk());
      if (!more.ok() || !*more) break;
      on_sent(request.chunk().offset());
      open = writer->Write(request);
    }
    if (!more.ok() || options_.interrupted()) context.TryCancel();
    writer->WritesDone();
    absl::Status status = StatusOfCall(writer->Finish());
    if (!more.ok()) return OfThisMachine(more.status());
    if (status.ok()) on_sent(asset.ref.size());
    return status;
  }

  // The status of a call, with a message for the user.
  absl::Status StatusOfCall(const grpc::Status& outcome) const {
    absl::Status status = rpc::StatusFromGrpc(outcome);
    if (!status.ok() && options_.interrupted()) return absl::CancelledError("interrupted");
    // Without an interruption, kCancelled means that the other side closed the connection.
    if (!rpc::IsTransient(status) && !absl::IsCancelled(status)) return status;
    return CannotReach(options_.coordinator, status.message());
  }

  const std::unique_ptr<v1::FarmService::Stub> stub_;
  const FarmClientOptions options_;
};

}  // namespace

absl::Status CannotReach(const std::string& coordinator, absl::string_view message) {
  // gRPC lists all addresses it tried; the last error is enough for the user.
  constexpr absl::string_view kLead = "Failed to connect to remote host: ";
  const size_t at = message.rfind(kLead);
  const absl::string_view reason =
      at == absl::string_view::npos ? message : message.substr(at + kLead.size());
  return absl::UnavailableError(absl::StrCat("cannot reach the coordinator at ", coordinator, ": ", reason));
}

std::unique_ptr<FarmClient> MakeFarmClient(std::shared_ptr<grpc::Channel> channel,
                                           FarmClientOptions options) {
  return std::make_unique<GrpcFarmClient>(std::move(channel), std::move(options));
}

std::unique_ptr<FarmClient> ConnectTo(FarmClientOptions options) {
  auto channel = rpc::MakeChannel(options.coordinator, options.security);
  return MakeFarmClient(std::move(channel), std::move(options));
}

}  // namespace lumifold::client
