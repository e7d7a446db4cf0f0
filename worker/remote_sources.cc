#include "worker/remote_sources.h"

#include <grpcpp/grpcpp.h>

#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/retry.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::worker {
namespace {

/// Time limit of one transfer of an asset; large scenes may be sent over slow networks.
constexpr absl::Duration kAssetTimeout = absl::Minutes(10);
/// A spec has at most 4 MiB. Its leases expire meanwhile if the coordinator does not answer.
const rpc::RetryPolicy kSpecPolicy = {.try_timeout = absl::Seconds(30), .total_timeout = absl::Seconds(60)};

/// Makes a call with the worker's id. While the worker is not connected, or if it was not the one that it is now, a
/// refusal says nothing of its lease: the call is tried again.
absl::Status CallAs(const AssignedId& id, absl::FunctionRef<absl::Status(const std::string&)> call) {
  const std::string worker_id = id.Get();
  if (worker_id.empty()) return absl::UnavailableError("not connected to the coordinator");
  absl::Status status = call(worker_id);
  if (absl::IsPermissionDenied(status) && id.Get() != worker_id)
    return absl::UnavailableError("the connection to the coordinator was lost");
  return status;
}

class RemoteAssetSource final : public AssetSource {
 public:
  RemoteAssetSource(std::shared_ptr<grpc::Channel> channel, const AssignedId* id)
      : stub_(v1::WorkerService::NewStub(std::move(channel))), id_(id) {}

  absl::StatusOr<std::string> Fetch(const std::string& job_id, const v1::AssetRef& asset) override {
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
                             return CallAs(*id_, [&](const std::string& worker_id) {
                               request.set_worker_id(worker_id);
                               return Continue(asset, request, context, &bytes);
                             });
                           });
    if (!status.ok()) return status;
    if (rpc::Sha256Hex(bytes) != asset.sha256()) {
      return absl::DataLossError(absl::StrCat("asset ", asset.sha256(), " does not match its SHA-256"));
    }
    return bytes;
  }

 private:
  /// Appends the missing bytes of the asset to *bytes.
  absl::Status Continue(const v1::AssetRef& asset, v1::FetchAssetRequest request,
                        grpc::ClientContext& context, std::string* bytes) const {
    request.set_offset(bytes->size());
    const std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> reader = stub_->FetchAsset(&context, request);
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

  std::unique_ptr<v1::WorkerService::Stub> stub_;
  const AssignedId* const id_;
};

class RemoteSpecSource final : public SpecSource {
 public:
  RemoteSpecSource(std::shared_ptr<grpc::Channel> channel, const AssignedId* id)
      : stub_(v1::WorkerService::NewStub(std::move(channel))), id_(id) {}

  absl::StatusOr<v1::JobSpec> Fetch(const std::string& job_id) override {
    v1::FetchSpecRequest request;
    request.set_job_id(job_id);
    v1::JobSpec spec;
    const absl::Status status =
        rpc::CallWithRetry(kSpecPolicy, rpc::Idempotency::kIdempotent, rpc::RetryEnvironment::Real(),
                           [&](grpc::ClientContext& context) {
                             return CallAs(*id_, [&](const std::string& worker_id) {
                               request.set_worker_id(worker_id);
                               return rpc::StatusFromGrpc(stub_->FetchSpec(&context, request, &spec));
                             });
                           });
    if (!status.ok())
      return absl::Status(status.code(), absl::StrCat("the spec of job ", job_id, ": ", status.message()));
    return spec;
  }

 private:
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  const AssignedId* const id_;
};

}  // namespace

std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel,
                                                   const AssignedId* id) {
  return std::make_unique<RemoteAssetSource>(std::move(channel), id);
}

std::unique_ptr<SpecSource> MakeRemoteSpecSource(std::shared_ptr<grpc::Channel> channel,
                                                 const AssignedId* id) {
  return std::make_unique<RemoteSpecSource>(std::move(channel), id);
}

}  // namespace lumifold::worker
