#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/assets/asset_store.h"
#include "server/cluster/farm_peers.h"
#include "server/cluster/remote_watch.h"
#include "server/coordinator/roles.h"
#include "server/job/job_state.h"
#include "server/metrics/traffic.h"
#include "server/services/file_reader.h"
#include "server/services/unary_calls.h"

/// Reactors of FarmService's streams. A reactor exists from the start of its call to OnDone, where it deletes
/// itself.
namespace lumifold::server {

/// An asset that is uploaded.
class AssetTarget {
 public:
  AssetTarget(SubmissionApi* submissions, Traffic* traffic, std::string limit_key)
      : submissions_(submissions), traffic_(traffic), limit_key_(std::move(limit_key)) {}

  static std::string SubjectOf(const v1::UploadAssetRequest& request) { return request.announce().sha256(); }
  absl::Status Announce(const v1::UploadAssetRequest& request) {
    sha256_ = request.announce().sha256();
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload =
        submissions_->ReceiveAsset(request.announce(), limit_key_);
    absl::Status status = upload.status();
    if (upload.ok()) upload_ = *std::move(upload);
    return status;
  }
  absl::Status Add(const v1::ByteChunk& chunk) {
    traffic_->assets_received += static_cast<int64_t>(chunk.data().size());
    return submissions_->NoteError(upload_->Add(chunk));
  }
  absl::Status Finish() {
    absl::Status stored = submissions_->NoteError(upload_->Finish());
    if (stored.ok()) submissions_->OnAssetStored(sha256_);
    return stored;
  }

 private:
  SubmissionApi* const submissions_;
  Traffic* const traffic_;
  const std::string limit_key_;
  std::string sha256_;
  std::unique_ptr<AssetUpload> upload_;
};
using AssetReader = FileReader<v1::UploadAssetRequest, AssetTarget>;

/// Streams the status of a job. A slow caller may miss intermediate states, but gets the last one.
class StatusWriter final : public grpc::ServerWriteReactor<v1::JobStatus>, public JobWatcher {
 public:
  StatusWriter(AdmittedCall call, JobApi* jobs) : call_(std::move(call)), jobs_(jobs) {}

  /// Begins with a job of this coordinator, or of another one.
  void Watch(const std::string& job_id) {
    const absl::Status status = jobs_->Watch(job_id, this);
    if (!status.ok()) End(rpc::GrpcFromStatus(status));
  }
  /// The caller gets what is recorded of the job first, so that it knows the job and watches again where its
  /// owner is gone; then it finds who owns the job.
  void WatchAt(const absl::StatusOr<cluster::FarmPeers::Peer>& owner, const cluster::FarmPeers& peers,
               const v1::WatchJobRequest& request) {
    const absl::StatusOr<v1::JobStatus> recorded = jobs_->GetJob(request.job_id());
    if (recorded.ok()) OnStatus(*recorded);
    if (!recorded.ok() || !owner.ok())
      return End(rpc::GrpcFromStatus(recorded.ok() ? owner.status() : recorded.status()));
    remote_ = cluster::RemoteWatch::Start(
        *owner, peers, call_->caller(), call_->trace_parent(), request,
        {.on_status = [this](const v1::JobStatus& status) { OnStatus(status); },
         .on_end = [this](const absl::Status& status) { End(rpc::GrpcFromStatus(status)); }});
  }

  void OnStatus(const v1::JobStatus& status) override {
    absl::MutexLock lock(&mutex_);
    next_ = status;
    Continue();
  }
  void OnLost(const absl::Status& cause) override { End(rpc::GrpcFromStatus(cause)); }
  void OnWriteDone(bool ok) override {
    absl::MutexLock lock(&mutex_);
    call_->PeerMoved();
    writing_ = false;
    if (ok && job::HasEnded(current_.state())) end_ = grpc::Status::OK;
    if (!ok) end_ = grpc::Status::CANCELLED;
    if (end_.has_value() && (!ok || end_->ok())) next_.reset();
    Continue();
  }
  void OnCancel() override { End(grpc::Status::CANCELLED); }
  void OnDone() override {
    jobs_->Unwatch(this);
    if (remote_ != nullptr) remote_->Stop();
    delete this;
  }

 private:
  void End(const grpc::Status& status) {
    absl::MutexLock lock(&mutex_);
    end_ = status;
    if (status.error_code() == grpc::StatusCode::CANCELLED) next_.reset();
    Continue();
  }

  // Starts the next operation unless a write is in progress: a write, or the end of the call.
  void Continue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_ || finished_) return;
    if (!next_.has_value()) {
      if (!end_.has_value()) return;
      finished_ = true;
      return Finish(*end_);
    }
    current_ = *std::exchange(next_, std::nullopt);
    writing_ = true;
    call_->AwaitPeer();
    StartWrite(&current_);
  }

  const AdmittedCall call_;
  JobApi* const jobs_;
  std::shared_ptr<cluster::RemoteWatch> remote_;  // of a job of another coordinator
  absl::Mutex mutex_;
  v1::JobStatus current_;  // used by gRPC while writing_
  std::optional<v1::JobStatus> next_ ABSL_GUARDED_BY(mutex_);
  std::optional<grpc::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace lumifold::server
