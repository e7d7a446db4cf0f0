#include "server/grpc_adapter.h"

#include <deque>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/coordinator_impl.h"
#include "server/job_status.h"
#include "server/worker_session.h"

// A reactor exists from the start of its call to OnDone, where it deletes itself.

namespace lumifold::server {
namespace {

template <typename Response>
grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, absl::StatusOr<Response> result,
                                 Response* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (result.ok()) *response = *std::move(result);
  reactor->Finish(rpc::GrpcFromStatus(result.status()));
  return reactor;
}

/// Streams a file to the caller.
class FileWriter final : public grpc::ServerWriteReactor<v1::ByteChunk> {
 public:
  explicit FileWriter(absl::StatusOr<rpc::ByteSender> sender) : sender_(std::move(sender)) { WriteNext(); }

  void OnWriteDone(bool ok) override {
    if (ok) {
      WriteNext();
    } else {
      Finish(grpc::Status::CANCELLED);
    }
  }
  void OnDone() override { delete this; }

 private:
  void WriteNext() {
    if (!sender_.ok()) return Finish(rpc::GrpcFromStatus(sender_.status()));
    const absl::StatusOr<bool> has_next = sender_->Next(&chunk_);
    if (!has_next.ok() || !*has_next) return Finish(rpc::GrpcFromStatus(has_next.status()));
    StartWrite(&chunk_);
  }

  absl::StatusOr<rpc::ByteSender> sender_;
  v1::ByteChunk chunk_;
};

/// Receives an asset.
class AssetReader final : public grpc::ServerReadReactor<v1::UploadAssetRequest> {
 public:
  explicit AssetReader(Coordinator* coordinator) : coordinator_(coordinator) { StartRead(&request_); }

  void OnReadDone(bool ok) override {
    const absl::Status status = ok ? Take() : End();
    if (ok && status.ok()) return StartRead(&request_);
    upload_.reset();  // first, so that what has arrived is kept before the caller gets the error
    Finish(rpc::GrpcFromStatus(status));
  }
  void OnDone() override { delete this; }

 private:
  absl::Status Take() {
    if (request_.has_announce() == (upload_ != nullptr)) {
      return absl::InvalidArgumentError(
          "UploadAsset: the first message, and no other, must announce the asset");
    }
    if (upload_ != nullptr) return upload_->Add(request_.chunk());
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = coordinator_->ReceiveAsset(request_.announce());
    if (upload.ok()) upload_ = *std::move(upload);
    return upload.status();
  }

  absl::Status End() {
    if (upload_ == nullptr) return absl::InvalidArgumentError("UploadAsset: no asset was announced");
    return upload_->Finish();
  }

  Coordinator* const coordinator_;
  v1::UploadAssetRequest request_;
  std::unique_ptr<AssetUpload> upload_;
};

/// Streams the status of a job. A slow caller may miss intermediate states, but gets the last one.
class StatusWriter final : public grpc::ServerWriteReactor<v1::JobStatus>, public JobWatcher {
 public:
  StatusWriter(Coordinator* coordinator, const std::string& job_id) : coordinator_(coordinator) {
    const absl::Status status = coordinator_->Watch(job_id, this);
    if (!status.ok()) End(rpc::GrpcFromStatus(status));
  }

  void OnStatus(const v1::JobStatus& status) override {
    absl::MutexLock lock(&mutex_);
    next_ = status;
    Continue();
  }
  void OnWriteDone(bool ok) override {
    absl::MutexLock lock(&mutex_);
    writing_ = false;
    if (!ok) {
      end_ = grpc::Status::CANCELLED;
      next_.reset();
    } else if (HasEnded(current_.state())) {
      end_ = grpc::Status::OK;
    }
    Continue();
  }
  void OnCancel() override { End(grpc::Status::CANCELLED); }
  void OnDone() override {
    coordinator_->Unwatch(this);
    delete this;
  }

 private:
  void End(const grpc::Status& status) {
    absl::MutexLock lock(&mutex_);
    end_ = status;
    next_.reset();
    Continue();
  }

  // Starts the next operation unless a write is in progress: a write, or the end of the call.
  void Continue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_ || finished_) return;
    if (end_.has_value()) {
      finished_ = true;
      return Finish(*end_);
    }
    if (!next_.has_value()) return;
    current_ = *std::exchange(next_, std::nullopt);
    writing_ = true;
    StartWrite(&current_);
  }

  Coordinator* const coordinator_;
  absl::Mutex mutex_;
  v1::JobStatus current_;  // used by gRPC while writing_
  std::optional<v1::JobStatus> next_ ABSL_GUARDED_BY(mutex_);
  std::optional<grpc::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

/// The stream of a worker. The coordinator calls Send while it holds its own lock, so mutex_ is never held
/// during a call to the coordinator.
class WorkStream final : public grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>,
                         public WorkerSink {
 public:
  explicit WorkStream(Coordinator* coordinator) : coordinator_(coordinator) { StartRead(&incoming_); }

  void OnReadDone(bool ok) override {
    const absl::Status status = ok ? Take() : absl::CancelledError("the worker disconnected");
    if (status.ok()) return StartRead(&incoming_);
    session_.reset();  // voids the leases
    absl::MutexLock lock(&mutex_);
    end_ = ok ? rpc::GrpcFromStatus(status) : grpc::Status::OK;
    Continue();
  }

  void Send(const v1::CoordinatorMessage& message) override {
    absl::MutexLock lock(&mutex_);
    if (end_.has_value() || broken_) return;
    outgoing_.push_back(message);
    Continue();
  }

  void OnWriteDone(bool ok) override {
    absl::MutexLock lock(&mutex_);
    writing_ = false;
    outgoing_.pop_front();
    if (!ok) {
      broken_ = true;  // the read fails too and ends the stream
      outgoing_.clear();
    }
    Continue();
  }

  void OnDone() override { delete this; }

 private:
  absl::Status Take() {
    if (session_ != nullptr) return session_->Handle(incoming_);
    if (!incoming_.has_hello())
      return absl::FailedPreconditionError("worker stream: the first message is not Hello");
    absl::StatusOr<std::unique_ptr<WorkerSession>> session =
        WorkerSession::Open(coordinator_, incoming_.hello(), this);
    if (session.ok()) session_ = *std::move(session);
    return session.status();
  }

  void Continue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_) return;
    if (end_.has_value()) return Finish(*end_);
    if (outgoing_.empty()) return;
    writing_ = true;
    StartWrite(&outgoing_.front());
  }

  Coordinator* const coordinator_;
  v1::WorkerMessage incoming_;
  std::unique_ptr<WorkerSession> session_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  std::deque<v1::CoordinatorMessage> outgoing_ ABSL_GUARDED_BY(mutex_);
  std::optional<grpc::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool broken_ ABSL_GUARDED_BY(mutex_) = false;
};

class FarmServiceAdapter final : public v1::FarmService::CallbackService {
 public:
  explicit FarmServiceAdapter(Coordinator* coordinator) : coordinator_(coordinator) {}

  grpc::ServerUnaryReactor* FindMissingAssets(grpc::CallbackServerContext* context,
                                              const v1::FindMissingAssetsRequest* request,
                                              v1::FindMissingAssetsResponse* response) override {
    return Answer(context, coordinator_->FindMissingAssets(*request), response);
  }
  grpc::ServerUnaryReactor* FindUpload(grpc::CallbackServerContext* context,
                                       const v1::FindUploadRequest* request,
                                       v1::FindUploadResponse* response) override {
    return Answer(context, coordinator_->FindUpload(*request), response);
  }
  grpc::ServerReadReactor<v1::UploadAssetRequest>* UploadAsset(grpc::CallbackServerContext*,
                                                               v1::UploadAssetResponse*) override {
    return new AssetReader(coordinator_);
  }
  grpc::ServerUnaryReactor* SubmitJob(grpc::CallbackServerContext* context,
                                      const v1::SubmitJobRequest* request,
                                      v1::SubmitJobResponse* response) override {
    return Answer(context, coordinator_->SubmitJob(*request), response);
  }
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* context, const v1::GetJobRequest* request,
                                   v1::JobStatus* response) override {
    return Answer(context, coordinator_->GetJob(request->job_id()), response);
  }
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context, const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override {
    return Answer(context, coordinator_->ListJobs(*request), response);
  }
  grpc::ServerWriteReactor<v1::JobStatus>* WatchJob(grpc::CallbackServerContext*,
                                                    const v1::WatchJobRequest* request) override {
    return new StatusWriter(coordinator_, request->job_id());
  }
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request, v1::JobStatus* response) override {
    return Answer(context, coordinator_->CancelJob(request->job_id()), response);
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* DownloadResult(grpc::CallbackServerContext*,
                                                          const v1::DownloadResultRequest* request) override {
    return new FileWriter(coordinator_->OpenResult(*request));
  }

 private:
  Coordinator* const coordinator_;
};

class WorkerServiceAdapter final : public v1::WorkerService::CallbackService {
 public:
  explicit WorkerServiceAdapter(Coordinator* coordinator) : coordinator_(coordinator) {}

  grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>* Work(
      grpc::CallbackServerContext*) override {
    return new WorkStream(coordinator_);
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* FetchAsset(grpc::CallbackServerContext*,
                                                      const v1::FetchAssetRequest* request) override {
    return new FileWriter(coordinator_->OpenAsset(*request));
  }

 private:
  Coordinator* const coordinator_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(std::make_unique<FarmServiceAdapter>(coordinator));
  services.push_back(std::make_unique<WorkerServiceAdapter>(coordinator));
  return services;
}

}  // namespace lumifold::server
