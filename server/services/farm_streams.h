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
#include "server/services/unary_calls.h"

/// Reactors of FarmService's streams. A reactor exists from the start of its call to OnDone, where it deletes
/// itself.
namespace lumifold::server {

/// Receives an asset.
class AssetReader final : public grpc::ServerReadReactor<v1::UploadAssetRequest> {
 public:
  AssetReader(AdmittedCall call, SubmissionApi* submissions, Traffic* traffic)
      : call_(std::move(call)), submissions_(submissions), traffic_(traffic) {
    call_->SetEnd([this](const absl::Status& why) {
      absl::MutexLock lock(&mutex_);
      EndWith(why);
    });
    absl::MutexLock lock(&mutex_);
    ReadNext();
  }

  void OnReadDone(bool ok) override {
    call_->PeerMoved(ok ? request_.chunk().data().size() : 0);
    if (HasEnded()) {
      upload_.reset();
      return;
    }
    const absl::Status status = ok ? Take() : End();
    const bool goes_on = ok && status.ok();
    if (!goes_on)
      upload_.reset();  // first, so that what has arrived is kept before the caller gets the error
    absl::MutexLock lock(&mutex_);
    if (!goes_on) {
      EndWith(status);
    } else if (!ended_) {
      ReadNext();
    }
  }
  void OnDone() override { delete this; }

 private:
  bool HasEnded() {
    absl::MutexLock lock(&mutex_);
    return ended_;
  }
  void ReadNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    call_->AwaitPeer();
    StartRead(&request_);
  }
  // A read that is under way then fails.
  void EndWith(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (std::exchange(ended_, true)) return;
    call_->End(status);
    Finish(rpc::GrpcFromStatus(status));
  }

  absl::Status Take() {
    if (request_.has_announce() == (upload_ != nullptr)) {
      return absl::InvalidArgumentError(
          "UploadAsset: the first message, and no other, must announce the asset");
    }
    if (upload_ != nullptr) {
      traffic_->assets_received += static_cast<int64_t>(request_.chunk().data().size());
      return submissions_->NoteError(upload_->Add(request_.chunk()));
    }
    sha256_ = request_.announce().sha256();
    {
      absl::MutexLock lock(&mutex_);  // the call may be ended meanwhile
      call_->SetSubject(sha256_);
    }
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload =
        submissions_->ReceiveAsset(request_.announce(), call_->limit_key());
    absl::Status status = upload.status();
    if (upload.ok()) upload_ = *std::move(upload);
    return status;
  }

  absl::Status End() {
    if (upload_ == nullptr) return absl::InvalidArgumentError("UploadAsset: no asset was announced");
    absl::Status stored = submissions_->NoteError(upload_->Finish());
    if (stored.ok()) submissions_->OnAssetStored(sha256_);
    return stored;
  }

  const AdmittedCall call_;
  SubmissionApi* const submissions_;
  Traffic* const traffic_;
  v1::UploadAssetRequest request_;
  std::string sha256_;
  std::unique_ptr<AssetUpload> upload_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
};

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
