#include "worker/connection/remote_sources.h"

#include <grpcpp/grpcpp.h>

#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/retry.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::worker {
namespace {

/// Time limit of one transfer of an asset or of a frame's units; they may be large, and the network slow.
constexpr absl::Duration kAssetTimeout = absl::Minutes(10);
/// A spec has at most 4 MiB. Its leases expire meanwhile if the coordinator does not answer.
const rpc::RetryPolicy kSpecPolicy = {.try_timeout = absl::Seconds(30), .total_timeout = absl::Seconds(60)};

/// Makes a call on the current connection. While there is none, or if it was lost during the call, a refusal
/// says nothing of the worker's lease: the call is tried again.
absl::Status CallCurrent(
    const CurrentCoordinator& coordinator,
    absl::FunctionRef<absl::Status(v1::WorkerService::Stub&, const std::string& worker_id)> call) {
  const CurrentCoordinator::Link link = coordinator.Get();
  if (link.channel == nullptr) return absl::UnavailableError("not connected to the coordinator");
  absl::Status status = call(*v1::WorkerService::NewStub(link.channel), link.worker_id);
  const bool is_refused = absl::IsPermissionDenied(status) || absl::IsNotFound(status);
  if (is_refused && coordinator.Get().number != link.number)
    return absl::UnavailableError("the connection to the coordinator was lost");
  return status;
}

void AddTrace(logging::JobLabels& labels, const std::string& job_id, grpc::ClientContext* context) {
  const std::string trace_id = labels.Of(job_id).trace;
  if (!trace_id.empty())
    context->AddMetadata(rpc::kTraceParentKey, rpc::MakeTraceParent(trace_id, rpc::SystemRandom));
}

class RemoteAssetSource final : public AssetSource {
 public:
  RemoteAssetSource(const CurrentCoordinator* coordinator, std::shared_ptr<logging::JobLabels> labels)
      : coordinator_(coordinator), labels_(std::move(labels)) {}

  absl::StatusOr<AssetContent> Fetch(const std::string& job_id, const v1::AssetRef& asset) override {
    std::string bytes;
    rpc::RetryPolicy policy;
    policy.try_timeout = kAssetTimeout;
    policy.total_timeout = 2 * kAssetTimeout;
    v1::FetchAssetRequest request;
    request.set_sha256(asset.sha256());
    request.set_job_id(job_id);
    const absl::Status status =
        rpc::CallWithRetry(policy, rpc::Idempotency::kIdempotent, rpc::RetryEnvironment::Real(),
                           [&](grpc::ClientContext& context) {
                             AddTrace(*labels_, job_id, &context);
                             return CallCurrent(*coordinator_, [&](auto& stub, const std::string& worker_id) {
                               request.set_worker_id(worker_id);
                               return Continue(asset, request, stub, context, &bytes);
                             });
                           });
    if (!status.ok()) return status;
    if (rpc::Sha256Hex(bytes) != asset.sha256()) {
      return absl::DataLossError(absl::StrCat("asset ", asset.sha256(), " does not match its SHA-256"));
    }
    return std::make_shared<const std::string>(std::move(bytes));
  }

 private:
  /// Appends the missing bytes of the asset to *bytes.
  static absl::Status Continue(const v1::AssetRef& asset, v1::FetchAssetRequest request,
                               v1::WorkerService::Stub& stub, grpc::ClientContext& context,
                               std::string* bytes) {
    request.set_offset(bytes->size());
    const std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> reader = stub.FetchAsset(&context, request);
    v1::ByteChunk chunk;
    while (reader->Read(&chunk)) {
      if (chunk.offset() != bytes->size() || chunk.checksum() != rpc::Checksum(chunk.data()) ||
          bytes->size() + chunk.data().size() > asset.size()) {
        context.TryCancel();
        reader->Finish();
        return absl::UnavailableError(absl::StrCat("asset ", asset.sha256(), " was damaged in transit"));
      }
      bytes->append(chunk.data());
    }
    absl::Status status = rpc::StatusFromGrpc(reader->Finish());
    if (status.ok() && bytes->size() != asset.size()) status = absl::UnavailableError("asset ended early");
    return status;
  }

  const CurrentCoordinator* const coordinator_;
  const std::shared_ptr<logging::JobLabels> labels_;
};

class RemoteSpecSource final : public SpecSource {
 public:
  RemoteSpecSource(const CurrentCoordinator* coordinator, std::shared_ptr<logging::JobLabels> labels)
      : coordinator_(coordinator), labels_(std::move(labels)) {}

  absl::StatusOr<v1::JobSpec> Fetch(const std::string& job_id) override {
    v1::FetchSpecRequest request;
    request.set_job_id(job_id);
    v1::JobSpec spec;
    const absl::Status status =
        rpc::CallWithRetry(kSpecPolicy, rpc::Idempotency::kIdempotent, rpc::RetryEnvironment::Real(),
                           [&](grpc::ClientContext& context) {
                             AddTrace(*labels_, job_id, &context);
                             return CallCurrent(*coordinator_, [&](auto& stub, const std::string& worker_id) {
                               request.set_worker_id(worker_id);
                               return rpc::StatusFromGrpc(stub.FetchSpec(&context, request, &spec));
                             });
                           });
    if (!status.ok())
      return absl::Status(status.code(), absl::StrCat("the spec of job ", job_id, ": ", status.message()));
    return spec;
  }

 private:
  const CurrentCoordinator* const coordinator_;
  const std::shared_ptr<logging::JobLabels> labels_;
};

class RemoteFrameLink final : public FrameLink {
 public:
  RemoteFrameLink(const CurrentCoordinator* coordinator, std::shared_ptr<logging::JobLabels> labels)
      : coordinator_(coordinator), labels_(std::move(labels)) {}

  absl::Status FetchUnits(const v1::Lease& lease,
                          absl::FunctionRef<absl::Status(const v1::ByteChunk&)> take) override {
    return Call(lease, [&](v1::WorkerService::Stub& stub, const std::string& worker_id,
                           grpc::ClientContext& context) {
      v1::FetchUnitsRequest request;
      request.set_worker_id(worker_id);
      *request.mutable_unit() = lease.unit();
      request.set_attempt(lease.attempt());
      const std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> reader = stub.FetchUnits(&context, request);
      v1::ByteChunk chunk;
      while (reader->Read(&chunk)) {
        if (absl::Status status = take(chunk); !status.ok()) {
          context.TryCancel();
          reader->Finish();
          return status;
        }
      }
      return rpc::StatusFromGrpc(reader->Finish());
    });
  }

  absl::Status DeliverResult(const v1::Lease& lease, const v1::FrameReport& report,
                             absl::FunctionRef<absl::StatusOr<bool>(v1::ByteChunk*)> next) override {
    return Call(lease, [&](v1::WorkerService::Stub& stub, const std::string& worker_id,
                           grpc::ClientContext& context) {
      v1::DeliverResultResponse response;
      const std::unique_ptr<grpc::ClientWriter<v1::DeliverResultRequest>> writer =
          stub.DeliverResult(&context, &response);
      v1::DeliverResultRequest request;
      request.mutable_announce()->set_worker_id(worker_id);
      *request.mutable_announce()->mutable_unit() = lease.unit();
      request.mutable_announce()->set_attempt(lease.attempt());
      *request.mutable_announce()->mutable_times() = report.times();
      if (report.has_estimated_error())
        request.mutable_announce()->set_estimated_error(report.estimated_error());
      bool goes_on = writer->Write(request);
      while (goes_on) {
        const absl::StatusOr<bool> has_next = next(request.mutable_chunk());
        if (!has_next.ok()) {
          context.TryCancel();
          writer->Finish();
          return has_next.status();
        }
        if (!*has_next) break;
        goes_on = writer->Write(request);
      }
      if (goes_on) writer->WritesDone();
      return rpc::StatusFromGrpc(writer->Finish());
    });
  }

 private:
  using Body = absl::FunctionRef<absl::Status(v1::WorkerService::Stub&, const std::string& worker_id,
                                              grpc::ClientContext& context)>;

  absl::Status Call(const v1::Lease& lease, Body body) const {
    grpc::ClientContext context;
    context.set_deadline(rpc::MonotonicDeadline(kAssetTimeout));
    AddTrace(*labels_, lease.unit().job_id(), &context);
    return CallCurrent(*coordinator_, [&](v1::WorkerService::Stub& stub, const std::string& worker_id) {
      return body(stub, worker_id, context);
    });
  }

  const CurrentCoordinator* const coordinator_;
  const std::shared_ptr<logging::JobLabels> labels_;
};

}  // namespace

std::unique_ptr<FrameLink> MakeRemoteFrameLink(const CurrentCoordinator* coordinator,
                                               std::shared_ptr<logging::JobLabels> labels) {
  return std::make_unique<RemoteFrameLink>(coordinator, std::move(labels));
}

std::unique_ptr<AssetSource> MakeRemoteAssetSource(const CurrentCoordinator* coordinator,
                                                   std::shared_ptr<logging::JobLabels> labels) {
  return std::make_unique<RemoteAssetSource>(coordinator, std::move(labels));
}

std::unique_ptr<SpecSource> MakeRemoteSpecSource(const CurrentCoordinator* coordinator,
                                                 std::shared_ptr<logging::JobLabels> labels) {
  return std::make_unique<RemoteSpecSource>(coordinator, std::move(labels));
}

}  // namespace lumifold::worker
