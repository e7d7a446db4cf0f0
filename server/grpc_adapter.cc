#include "server/grpc_adapter.h"

#include <deque>
#include <functional>
#include <optional>
#include <set>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/asset_checks.h"
#include "server/coordinator_impl.h"
#include "server/job_status.h"
#include "server/worker_session.h"

// A reactor exists from the start of its call to OnDone, where it deletes itself.

namespace lumifold::server {
namespace {

/// A worker that lets more than this wait is disconnected. A worker that reads has at most some grants of 256 leases
/// (25 KiB each) and an acknowledgement for each of its up to 1024 slots before it.
constexpr size_t kMaxOutgoingMessages = 8192;
constexpr size_t kMaxOutgoingBytes = size_t{4} << 20;

template <typename Response>
grpc::ServerUnaryReactor* Answer(grpc::CallbackServerContext* context, absl::StatusOr<Response> result,
                                 Response* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  if (result.ok()) *response = *std::move(result);
  reactor->Finish(rpc::GrpcFromStatus(result.status()));
  return reactor;
}

/// Answers a call that uses assets once these are checked.
template <typename Response>
grpc::ServerUnaryReactor* AnswerChecked(grpc::CallbackServerContext* context, AssetChecks* checks,
                                        const std::set<std::string>& assets,
                                        std::function<absl::StatusOr<Response>()> call, Response* response) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  checks->Check(assets, [=](const absl::Status& checked) {
    absl::StatusOr<Response> result = checked.ok() ? call() : absl::StatusOr<Response>(checked);
    if (result.ok()) *response = *std::move(result);
    reactor->Finish(rpc::GrpcFromStatus(result.status()));
  });
  return reactor;
}

/// Answers a call when the coordinator has done what it asks for. `response` may be null.
Coordinator::StatusAnswer AnswerLater(grpc::ServerUnaryReactor* reactor, v1::JobStatus* response) {
  return [reactor, response](absl::StatusOr<v1::JobStatus> status) {
    if (status.ok() && response != nullptr) *response = *std::move(status);
    reactor->Finish(rpc::GrpcFromStatus(status.status()));
  };
}

/// Streams a file to the caller, from Start on.
class FileWriter final : public grpc::ServerWriteReactor<v1::ByteChunk> {
 public:
  void Start(absl::StatusOr<rpc::ByteSender> sender) {
    sender_ = std::move(sender);
    WriteNext();
  }

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

  absl::StatusOr<rpc::ByteSender> sender_ = absl::UnknownError("not started");
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
    if (upload_ != nullptr) return coordinator_->NoteError(upload_->Add(request_.chunk()));
    sha256_ = request_.announce().sha256();
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = coordinator_->ReceiveAsset(request_.announce());
    if (upload.ok()) upload_ = *std::move(upload);
    return upload.status();
  }

  absl::Status End() {
    if (upload_ == nullptr) return absl::InvalidArgumentError("UploadAsset: no asset was announced");
    absl::Status stored = coordinator_->NoteError(upload_->Finish());
    if (stored.ok()) coordinator_->OnAssetStored(sha256_);
    return stored;
  }

  Coordinator* const coordinator_;
  v1::UploadAssetRequest request_;
  std::string sha256_;
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
  WorkStream(grpc::CallbackServerContext* context, Coordinator* coordinator)
      : context_(context), coordinator_(coordinator) {
    StartRead(&incoming_);
  }

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
    outgoing_bytes_ += message.ByteSizeLong();
    outgoing_.push_back(message);
    if (outgoing_.size() > kMaxOutgoingMessages || outgoing_bytes_ > kMaxOutgoingBytes) {
      // It sends, but does not read. Without a connection its leases go to others.
      broken_ = true;
      context_->TryCancel();
    }
    Continue();
  }

  void OnWriteDone(bool ok) override {
    absl::MutexLock lock(&mutex_);
    writing_ = false;
    outgoing_bytes_ -= outgoing_.front().ByteSizeLong();
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
    if (session_ != nullptr) return session_->Handle(&incoming_);
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

  grpc::CallbackServerContext* const context_;
  Coordinator* const coordinator_;
  v1::WorkerMessage incoming_;
  std::unique_ptr<WorkerSession> session_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  std::deque<v1::CoordinatorMessage> outgoing_ ABSL_GUARDED_BY(mutex_);
  size_t outgoing_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<grpc::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool broken_ ABSL_GUARDED_BY(mutex_) = false;
};

class FarmServiceAdapter final : public v1::FarmService::CallbackService {
 public:
  FarmServiceAdapter(Coordinator* coordinator, AssetChecks* checks)
      : coordinator_(coordinator), checks_(checks) {}

  grpc::ServerUnaryReactor* FindMissingAssets(grpc::CallbackServerContext* context,
                                              const v1::FindMissingAssetsRequest* request,
                                              v1::FindMissingAssetsResponse* response) override {
    std::set<std::string> assets;
    for (const v1::AssetRef& asset : request->assets()) assets.insert(asset.sha256());
    return AnswerChecked<v1::FindMissingAssetsResponse>(
        context, checks_, assets, [this, request] { return coordinator_->FindMissingAssets(*request); },
        response);
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
    std::set<std::string> assets = {request->spec().scene().file().sha256()};
    for (const v1::AssetRef& asset : request->spec().scene().dependencies()) assets.insert(asset.sha256());
    return AnswerChecked<v1::SubmitJobResponse>(
        context, checks_, assets, [this, request] { return coordinator_->SubmitJob(*request); }, response);
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
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    coordinator_->CancelJob(request->job_id(), AnswerLater(reactor, response));
    return reactor;
  }
  grpc::ServerUnaryReactor* RetryJob(grpc::CallbackServerContext* context, const v1::RetryJobRequest* request,
                                     v1::JobStatus* response) override {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    coordinator_->RetryJob(*request, AnswerLater(reactor, response));
    return reactor;
  }
  grpc::ServerUnaryReactor* AddSamples(grpc::CallbackServerContext* context,
                                       const v1::AddSamplesRequest* request,
                                       v1::JobStatus* response) override {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    coordinator_->AddSamples(*request, AnswerLater(reactor, response));
    return reactor;
  }
  grpc::ServerUnaryReactor* DeleteJob(grpc::CallbackServerContext* context,
                                      const v1::DeleteJobRequest* request, v1::DeleteJobResponse*) override {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    coordinator_->DeleteJob(*request, AnswerLater(reactor, /*response=*/nullptr));
    return reactor;
  }
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest*,
                                            v1::ServerStatus* response) override {
    return Answer(context, coordinator_->GetServerStatus(), response);
  }
  grpc::ServerUnaryReactor* PauseJob(grpc::CallbackServerContext* context, const v1::PauseJobRequest* request,
                                     v1::JobStatus* response) override {
    return Answer(context, coordinator_->PauseJob(request->job_id()), response);
  }
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* context,
                                      const v1::ResumeJobRequest* request, v1::JobStatus* response) override {
    return Answer(context, coordinator_->ResumeJob(request->job_id()), response);
  }
  grpc::ServerUnaryReactor* SetJobPriority(grpc::CallbackServerContext* context,
                                           const v1::SetJobPriorityRequest* request,
                                           v1::JobStatus* response) override {
    return Answer(context, coordinator_->SetJobPriority(*request), response);
  }
  grpc::ServerUnaryReactor* ExplainJob(grpc::CallbackServerContext* context,
                                       const v1::ExplainJobRequest* request,
                                       v1::ExplainJobResponse* response) override {
    return Answer(context, coordinator_->ExplainJob(request->job_id()), response);
  }
  grpc::ServerUnaryReactor* ListWorkers(grpc::CallbackServerContext* context,
                                        const v1::ListWorkersRequest* request,
                                        v1::ListWorkersResponse* response) override {
    return Answer(context, coordinator_->ListWorkers(*request), response);
  }
  grpc::ServerUnaryReactor* DrainWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return Answer(context, coordinator_->DrainWorker(*request), response);
  }
  grpc::ServerUnaryReactor* BlockWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return Answer(context, coordinator_->BlockWorker(*request), response);
  }
  grpc::ServerUnaryReactor* ReadmitWorker(grpc::CallbackServerContext* context,
                                          const v1::WorkerRequest* request,
                                          v1::WorkerStatus* response) override {
    return Answer(context, coordinator_->ReadmitWorker(*request), response);
  }
  grpc::ServerUnaryReactor* GetLog(grpc::CallbackServerContext* context, const v1::GetLogRequest* request,
                                   v1::GetLogResponse* response) override {
    return Answer(context, coordinator_->GetLog(*request), response);
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* DownloadResult(grpc::CallbackServerContext*,
                                                          const v1::DownloadResultRequest* request) override {
    auto* writer = new FileWriter();
    writer->Start(coordinator_->OpenResult(*request));
    return writer;
  }

 private:
  Coordinator* const coordinator_;
  AssetChecks* const checks_;
};

class WorkerServiceAdapter final : public v1::WorkerService::CallbackService {
 public:
  WorkerServiceAdapter(Coordinator* coordinator, AssetChecks* checks)
      : coordinator_(coordinator), checks_(checks) {}

  grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>* Work(
      grpc::CallbackServerContext* context) override {
    return new WorkStream(context, coordinator_);
  }
  grpc::ServerUnaryReactor* FetchSpec(grpc::CallbackServerContext* context,
                                      const v1::FetchSpecRequest* request, v1::JobSpec* response) override {
    return Answer(context, coordinator_->FetchSpec(*request), response);
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* FetchAsset(grpc::CallbackServerContext*,
                                                      const v1::FetchAssetRequest* request) override {
    auto* writer = new FileWriter();
    if (absl::Status allowed = coordinator_->CheckFetch(*request); !allowed.ok()) {
      writer->Start(std::move(allowed));
      return writer;
    }
    checks_->Check({request->sha256()}, [this, request, writer](const absl::Status& checked) {
      writer->Start(checked.ok() ? coordinator_->OpenAsset(*request) : checked);
    });
    return writer;
  }

 private:
  Coordinator* const coordinator_;
  AssetChecks* const checks_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator, AssetChecks* checks) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(std::make_unique<FarmServiceAdapter>(coordinator, checks));
  services.push_back(std::make_unique<WorkerServiceAdapter>(coordinator, checks));
  return services;
}

}  // namespace lumifold::server
