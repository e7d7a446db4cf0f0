#include "client/farm/farm_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <utility>

#include "absl/time/time.h"
#include "client/cli/exit_code.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::client {
namespace {

// A silent coordinator is found by the channel's keep-alive.
const CallPolicy kSlowCallPolicy = {
    .retry = {.try_timeout = absl::Seconds(30), .total_timeout = absl::Seconds(60), .max_tries = 3}};
// For calls that must not be repeated when it is unknown whether they took effect.
constexpr absl::Duration kOnceTimeout = absl::Seconds(30);
// Streams have longer deadlines than calls. The callers reopen a stream that broke or exceeded its deadline.
constexpr absl::Duration kStreamTimeout = absl::Minutes(10);
// Uploads over slower connections exceed their deadline and go on with a new call.
constexpr double kSlowestUploadBytesPerSecond = 128 * 1024;
// The coordinator reads assets that it has not used since its start. It manages 1.5 GB/s; a busy disk a tenth
// of that.
constexpr double kSlowestCheckBytesPerSecond = 150e6;
constexpr absl::Duration kTick = absl::Milliseconds(100);

/// Policy of a call for which the coordinator may have to read all files of a scene.
CallPolicy PolicyFor(const v1::SceneRef& scene) {
  double bytes = static_cast<double>(scene.file().size());
  for (const v1::AssetRef& asset : scene.dependencies()) bytes += static_cast<double>(asset.size());
  CallPolicy policy = kSlowCallPolicy;
  policy.retry.try_timeout += absl::Seconds(bytes / kSlowestCheckBytesPerSecond);
  policy.retry.total_timeout += absl::Seconds(bytes / kSlowestCheckBytesPerSecond);
  return policy;
}

class GrpcFarmClient : public FarmClient {
  using Stub = v1::FarmService::Stub;

 public:
  explicit GrpcFarmClient(Coordinators coordinators) : coordinators_(std::move(coordinators)) {}

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
    const double slowest = static_cast<double>(asset.ref.size() - offset) / kSlowestUploadBytesPerSecond;
    absl::Status local;
    // At another coordinator it may have to begin elsewhere, so the caller repeats it.
    absl::Status status = coordinators_.CallOnce(
        kSlowCallPolicy.retry.try_timeout + absl::Seconds(slowest),
        [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return UploadOnce(context, channel, asset, offset, on_sent, &local);
        });
    if (!local.ok()) return local;
    if (status.ok()) on_sent(asset.ref.size());
    return status;
  }

  absl::StatusOr<std::string> SubmitJob(const v1::SubmitJobRequest& request) override {
    const absl::StatusOr<v1::SubmitJobResponse> response =
        Unary<v1::SubmitJobResponse>(kSlowCallPolicy, &Stub::SubmitJob, request);
    if (!response.ok()) return response.status();
    return response->job_id();
  }

  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kShortCall, &Stub::GetJob, OfJob<v1::GetJobRequest>(job_id));
  }
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request) override {
    return Unary<v1::ListJobsResponse>(kShortCall, &Stub::ListJobs, request);
  }
  absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id) override {
    return Unary<v1::JobStatus>(kShortCall, &Stub::CancelJob, OfJob<v1::CancelJobRequest>(job_id));
  }
  absl::StatusOr<v1::JobStatus> SetJobPaused(const std::string& job_id, bool paused) override {
    return paused ? Unary<v1::JobStatus>(kShortCall, &Stub::PauseJob, OfJob<v1::PauseJobRequest>(job_id))
                  : Unary<v1::JobStatus>(kShortCall, &Stub::ResumeJob, OfJob<v1::ResumeJobRequest>(job_id));
  }
  absl::StatusOr<v1::JobStatus> SetJobPriority(const v1::SetJobPriorityRequest& request) override {
    return Unary<v1::JobStatus>(kShortCall, &Stub::SetJobPriority, request);
  }
  absl::Status DeleteJob(const std::string& job_id) override {
    return Unary<v1::DeleteJobResponse>(kShortCall, &Stub::DeleteJob, OfJob<v1::DeleteJobRequest>(job_id))
        .status();
  }
  absl::StatusOr<v1::JobStatus> RetryJob(const v1::RetryJobRequest& request) override {
    if (coordinators_.size() > 1) {  // finds one that answers
      if (const auto found = GetJob(request.job_id()); !found.ok()) return found.status();
    }
    v1::JobStatus job;
    absl::Status status = coordinators_.CallOnce(
        kOnceTimeout, [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return v1::FarmService::NewStub(channel)->RetryJob(&context, request, &job);
        });
    if (!status.ok()) return status;
    return job;
  }
  absl::StatusOr<v1::JobStatus> AddSamples(const std::string& job_id, int samples_per_pixel) override {
    auto request = OfJob<v1::AddSamplesRequest>(job_id);
    request.set_samples_per_pixel(samples_per_pixel);
    return Unary<v1::JobStatus>(kSlowCallPolicy, &Stub::AddSamples, request);
  }
  absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id) override {
    return Unary<v1::ExplainJobResponse>(kShortCall, &Stub::ExplainJob, OfJob<v1::ExplainJobRequest>(job_id));
  }

  absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request) override {
    return Unary<v1::ListWorkersResponse>(kShortCall, &Stub::ListWorkers, request);
  }
  absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kShortCall, &Stub::DrainWorker, request);
  }
  absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kShortCall, &Stub::BlockWorker, request);
  }
  absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request) override {
    return Unary<v1::WorkerStatus>(kShortCall, &Stub::ReadmitWorker, request);
  }
  absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request) override {
    return Unary<v1::GetLogResponse>(kShortCall, &Stub::GetLog, request);
  }
  absl::StatusOr<v1::GetUsageResponse> GetUsage(const v1::GetUsageRequest& request) override {
    return Unary<v1::GetUsageResponse>(kShortCall, &Stub::GetUsage, request);
  }
  absl::StatusOr<v1::ServerStatus> GetServerStatus() override {
    return Unary<v1::ServerStatus>(kShortCall, &Stub::GetServerStatus, v1::GetServerStatusRequest());
  }
  absl::StatusOr<v1::PageLink> CreatePageLink(const v1::CreatePageLinkRequest& request) override {
    return Unary<v1::PageLink>(kShortCall, &Stub::CreatePageLink, request);
  }
  absl::StatusOr<v1::Preview> GetPreview(const v1::GetPreviewRequest& request) override {
    return Unary<v1::Preview>(kSlowCallPolicy, &Stub::GetPreview, request);
  }

  absl::Status WatchJob(const std::string& job_id, absl::FunctionRef<void(const v1::JobStatus&)> on_status,
                        absl::FunctionRef<void()> on_tick) override {
    v1::WatchJobRequest request;
    request.set_job_id(job_id);
    bool answered = false;
    return coordinators_.Stream(
        kStreamTimeout, &answered,
        [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          const grpc::Status status = WatchOnce(context, channel, request, &answered, on_status, on_tick);
          // Nothing changed until the deadline of the stream: the coordinator is not lost.
          const bool was_silent = answered && status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED;
          return was_silent ? grpc::Status::OK : status;
        });
  }

  absl::Status DownloadResult(const std::string& job_id, int frame, uint64_t offset,
                              absl::FunctionRef<absl::Status(const v1::ByteChunk&)> on_chunk) override {
    v1::DownloadResultRequest request;
    request.set_job_id(job_id);
    request.set_frame(frame);
    request.set_offset(offset);
    absl::Status taken;
    bool answered = false;
    const absl::Status status = coordinators_.Stream(
        kStreamTimeout, &answered,
        [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          const auto reader = v1::FarmService::NewStub(channel)->DownloadResult(&context, request);
          v1::ByteChunk chunk;
          while (taken.ok() && !coordinators_.interrupted() && reader->Read(&chunk)) {
            answered = true;
            taken = on_chunk(chunk);
          }
          if (!taken.ok() || coordinators_.interrupted()) context.TryCancel();
          const grpc::Status finished = reader->Finish();
          return taken.ok() ? finished : grpc::Status::OK;  // the coordinator is not the cause
        });
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
      if (coordinators_.interrupted()) context.TryCancel();
      on_tick();
    }
    return ok;
  }

  grpc::Status WatchOnce(grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel,
                         const v1::WatchJobRequest& request, bool* answered,
                         absl::FunctionRef<void(const v1::JobStatus&)> on_status,
                         absl::FunctionRef<void()> on_tick) const {
    grpc::CompletionQueue queue;
    const auto reader = v1::FarmService::NewStub(channel)->AsyncWatchJob(&context, request, &queue, nullptr);
    v1::JobStatus job;
    bool more = Wait(queue, context, on_tick);
    while (more) {
      reader->Read(&job, nullptr);
      more = Wait(queue, context, on_tick);
      if (!more) break;
      *answered = true;
      on_status(job);
    }
    grpc::Status status;
    reader->Finish(&status, nullptr);
    Wait(queue, context, on_tick);
    return status;
  }

  template <typename Request>
  static Request OfJob(const std::string& job_id) {
    Request request;
    request.set_job_id(job_id);
    return request;
  }

  // A call with one request and one response, repeated as the policy says.
  template <typename Response, typename Request>
  absl::StatusOr<Response> Unary(const CallPolicy& policy,
                                 grpc::Status (Stub::*call)(grpc::ClientContext*, const Request&, Response*),
                                 const Request& request) {
    Response response;
    absl::Status status = coordinators_.Call(
        policy, [&](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return (v1::FarmService::NewStub(channel).get()->*call)(&context, request, &response);
        });
    if (!status.ok()) return status;
    return response;
  }

  // Sets *local to an error of this machine; the coordinator's status is then of no interest.
  grpc::Status UploadOnce(grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel,
                          const LocalAsset& asset, uint64_t offset, absl::FunctionRef<void(uint64_t)> on_sent,
                          absl::Status* local) const {
    absl::StatusOr<rpc::FileHandle> file = OpenAsset(asset);
    if (!file.ok()) {
      *local = OfThisMachine(file.status());
      return grpc::Status::OK;
    }
    absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::OfFile(*std::move(file), asset.path, offset);
    if (!sender.ok()) {
      *local = OfThisMachine(sender.status());
      return grpc::Status::OK;
    }
    v1::UploadAssetResponse response;
    const auto writer = v1::FarmService::NewStub(channel)->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_announce() = asset.ref;
    bool open = writer->Write(request);
    absl::StatusOr<bool> more = true;
    while (open && !coordinators_.interrupted()) {
      more = sender->Next(request.mutable_chunk());
      if (!more.ok() || !*more) break;
      on_sent(request.chunk().offset());
      open = writer->Write(request);
    }
    if (!more.ok() || coordinators_.interrupted()) context.TryCancel();
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    *local = OfThisMachine(more.status());
    return local->ok() ? status : grpc::Status::OK;
  }

  Coordinators coordinators_;
};

}  // namespace

std::unique_ptr<FarmClient> MakeFarmClient(std::shared_ptr<grpc::Channel> channel,
                                           FarmClientOptions options) {
  return std::make_unique<GrpcFarmClient>(Coordinators(
      std::move(options), [channel = std::move(channel)](const std::string&) { return channel; }));
}

std::unique_ptr<FarmClient> ConnectTo(const FarmClientOptions& options) {
  return std::make_unique<GrpcFarmClient>(Coordinators(options));
}

}  // namespace lumifold::client
