#include "client/farm_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/exit_code.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::client {
namespace {

// Short calls: few tries with short pauses, so that the user soon sees the error of a wrong address.
const rpc::RetryPolicy kCallPolicy = {
    .try_timeout = absl::Seconds(10), .total_timeout = absl::Seconds(20), .max_tries = 3};
const rpc::RetryPolicy kSlowCallPolicy = {
    .try_timeout = absl::Seconds(30), .total_timeout = absl::Seconds(60), .max_tries = 3};
// Streams have longer deadlines than calls. The callers reopen a stream that broke or exceeded its deadline.
constexpr absl::Duration kStreamTimeout = absl::Minutes(10);
// Uploads over slower connections exceed their deadline and go on with a new call.
constexpr double kSlowestUploadBytesPerSecond = 128 * 1024;
constexpr absl::Duration kTick = absl::Milliseconds(100);

// gRPC lists all addresses it tried; the last error is enough for the user.
absl::string_view Reason(absl::string_view message) {
  constexpr absl::string_view kLead = "Failed to connect to remote host: ";
  const size_t at = message.rfind(kLead);
  return at == absl::string_view::npos ? message : message.substr(at + kLead.size());
}

class GrpcFarmClient : public FarmClient {
 public:
  GrpcFarmClient(std::shared_ptr<grpc::Channel> channel, FarmClientOptions options)
      : stub_(v1::FarmService::NewStub(std::move(channel))), options_(std::move(options)) {}

  absl::StatusOr<std::vector<std::string>> FindMissingAssets(const v1::SceneRef& scene) override {
    v1::FindMissingAssetsRequest request;
    *request.add_assets() = scene.file();
    for (const v1::AssetRef& asset : scene.dependencies()) *request.add_assets() = asset;
    v1::FindMissingAssetsResponse response;
    const absl::Status status = Call(kSlowCallPolicy, [&](grpc::ClientContext& context) {
      return stub_->FindMissingAssets(&context, request, &response);
    });
    if (!status.ok()) return status;
    return std::vector<std::string>(response.missing_sha256().begin(), response.missing_sha256().end());
  }

  absl::StatusOr<uint64_t> FindUpload(const v1::AssetRef& asset) override {
    v1::FindUploadRequest request;
    *request.mutable_asset() = asset;
    v1::FindUploadResponse response;
    const absl::Status status = Call(kSlowCallPolicy, [&](grpc::ClientContext& context) {
      return stub_->FindUpload(&context, request, &response);
    });
    if (!status.ok()) return status;
    return std::min<uint64_t>(response.received_bytes(), asset.size());
  }

  absl::Status UploadAsset(const LocalAsset& asset, uint64_t offset,
                           absl::FunctionRef<void(uint64_t)> on_sent) override {
    grpc::ClientContext context;
    const double slowest = static_cast<double>(asset.ref.size() - offset) / kSlowestUploadBytesPerSecond;
    context.set_deadline(rpc::MonotonicDeadline(kSlowCallPolicy.try_timeout + absl::Seconds(slowest)));
    return UploadOnce(context, asset, offset, on_sent);
  }

  absl::StatusOr<std::string> SubmitJob(const v1::JobSpec& spec, const std::string& request_id) override {
    v1::SubmitJobRequest request;
    *request.mutable_spec() = spec;
    request.set_request_id(request_id);
    v1::SubmitJobResponse response;
    const absl::Status status = Call(kSlowCallPolicy, [&](grpc::ClientContext& context) {
      return stub_->SubmitJob(&context, request, &response);
    });
    if (!status.ok()) return status;
    return response.job_id();
  }

  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) override {
    v1::GetJobRequest request;
    request.set_job_id(job_id);
    v1::JobStatus job;
    const absl::Status status = Call(
        kCallPolicy, [&](grpc::ClientContext& context) { return stub_->GetJob(&context, request, &job); });
    if (!status.ok()) return status;
    return job;
  }

  absl::StatusOr<std::vector<v1::JobStatus>> ListJobs(int limit) override {
    v1::ListJobsRequest request;
    request.set_limit(limit);
    v1::ListJobsResponse response;
    const absl::Status status = Call(kCallPolicy, [&](grpc::ClientContext& context) {
      return stub_->ListJobs(&context, request, &response);
    });
    if (!status.ok()) return status;
    return std::vector<v1::JobStatus>(response.jobs().begin(), response.jobs().end());
  }

  absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id) override {
    v1::CancelJobRequest request;
    request.set_job_id(job_id);
    v1::JobStatus job;
    const absl::Status status = Call(
        kCallPolicy, [&](grpc::ClientContext& context) { return stub_->CancelJob(&context, request, &job); });
    if (!status.ok()) return status;
    return job;
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

  template <typename OneCall>
  absl::Status Call(const rpc::RetryPolicy& policy, const OneCall& call) const {
    return rpc::CallWithRetry(policy, rpc::Idempotency::kIdempotent, options_.time,
                              [&](grpc::ClientContext& context) { return StatusOfCall(call(context)); });
  }

  absl::Status UploadOnce(grpc::ClientContext& context, const LocalAsset& asset, uint64_t offset,
                          absl::FunctionRef<void(uint64_t)> on_sent) const {
    absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::Open(asset.path, offset);
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
    return absl::UnavailableError(absl::StrCat("cannot reach the coordinator at ", options_.coordinator, ": ",
                                               Reason(status.message())));
  }

  const std::unique_ptr<v1::FarmService::Stub> stub_;
  const FarmClientOptions options_;
};

}  // namespace

std::unique_ptr<FarmClient> MakeFarmClient(std::shared_ptr<grpc::Channel> channel,
                                           FarmClientOptions options) {
  return std::make_unique<GrpcFarmClient>(std::move(channel), std::move(options));
}

std::unique_ptr<FarmClient> ConnectTo(FarmClientOptions options) {
  auto channel = rpc::MakeChannel(options.coordinator, rpc::Security{});
  return MakeFarmClient(std::move(channel), std::move(options));
}

}  // namespace lumifold::client
