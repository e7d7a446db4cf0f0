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
#include "server/access/identity.h"
#include "server/asset_checks.h"
#include "server/call_gate.h"
#include "server/coordinator_impl.h"
#include "server/job_access.h"
#include "server/job_status.h"
#include "server/unary_calls.h"
#include "server/worker_session.h"

// A reactor exists from the start of its call to OnDone, where it deletes itself.

namespace lumifold::server {
namespace {

/// A worker that lets more than this wait is disconnected. A worker that reads has at most some grants of 256 leases
/// (25 KiB each) and an acknowledgement for each of its up to 1024 slots before it.
constexpr size_t kMaxOutgoingMessages = 8192;
constexpr size_t kMaxOutgoingBytes = size_t{4} << 20;

/// A stream that is refused.
template <typename Reactor>
class Refused final : public Reactor {
 public:
  explicit Refused(const absl::Status& status) { this->Finish(rpc::GrpcFromStatus(status)); }
  void OnDone() override { delete this; }
};

/// Streams a file to the caller, from Start on.
class FileWriter final : public grpc::ServerWriteReactor<v1::ByteChunk> {
 public:
  explicit FileWriter(AdmittedCall call) : call_(std::move(call)) {}

  void Start(absl::StatusOr<rpc::ByteSender> sender) {
    sender_ = std::move(sender);
    WriteNext();
  }

  void OnWriteDone(bool ok) override {
    call_->PeerMoved(chunk_.data().size());
    if (ok) {
      WriteNext();
    } else {
      Finish(grpc::Status::CANCELLED);
    }
  }
  void OnDone() override { delete this; }

 private:
  void WriteNext() {
    if (!sender_.ok()) {
      call_->End(sender_.status());
      return Finish(rpc::GrpcFromStatus(sender_.status()));
    }
    const absl::StatusOr<bool> has_next = sender_->Next(&chunk_);
    if (!has_next.ok() || !*has_next) return Finish(rpc::GrpcFromStatus(has_next.status()));
    call_->AwaitPeer();
    StartWrite(&chunk_);
  }

  const AdmittedCall call_;
  absl::StatusOr<rpc::ByteSender> sender_ = absl::UnknownError("not started");
  v1::ByteChunk chunk_;
};

/// Receives an asset.
class AssetReader final : public grpc::ServerReadReactor<v1::UploadAssetRequest> {
 public:
  AssetReader(AdmittedCall call, Coordinator* coordinator)
      : call_(std::move(call)), coordinator_(coordinator) {
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
    if (upload_ != nullptr) return coordinator_->NoteError(upload_->Add(request_.chunk()));
    sha256_ = request_.announce().sha256();
    {
      absl::MutexLock lock(&mutex_);  // the call may be ended meanwhile
      call_->SetSubject(sha256_);
    }
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload =
        coordinator_->ReceiveAsset(request_.announce(), call_->limit_key());
    if (upload.ok()) upload_ = *std::move(upload);
    return upload.status();
  }

  absl::Status End() {
    if (upload_ == nullptr) return absl::InvalidArgumentError("UploadAsset: no asset was announced");
    absl::Status stored = coordinator_->NoteError(upload_->Finish());
    if (stored.ok()) coordinator_->OnAssetStored(sha256_);
    return stored;
  }

  const AdmittedCall call_;
  Coordinator* const coordinator_;
  v1::UploadAssetRequest request_;
  std::string sha256_;
  std::unique_ptr<AssetUpload> upload_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
};

/// Streams the status of a job. A slow caller may miss intermediate states, but gets the last one.
class StatusWriter final : public grpc::ServerWriteReactor<v1::JobStatus>, public JobWatcher {
 public:
  StatusWriter(AdmittedCall call, Coordinator* coordinator, const std::string& job_id)
      : call_(std::move(call)), coordinator_(coordinator) {
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
    call_->PeerMoved();
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
    call_->AwaitPeer();
    StartWrite(&current_);
  }

  const AdmittedCall call_;
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
  WorkStream(grpc::CallbackServerContext* context, AdmittedCall call, Coordinator* coordinator)
      : context_(context), call_(std::move(call)), coordinator_(coordinator) {
    call_->SetEnd([this](const absl::Status& why) { EndEarly(why); });
    absl::MutexLock lock(&mutex_);
    ReadNext();
  }

  void OnReadDone(bool ok) override {
    call_->PeerMoved();
    const absl::Status status = ok ? Take() : absl::CancelledError("the worker disconnected");
    if (!status.ok()) session_.reset();  // voids the leases
    absl::MutexLock lock(&mutex_);
    if (end_.has_value()) return;  // EndEarly was first
    if (status.ok()) return ReadNext();
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

  void OnDone() override {
    session_.reset();  // it may send until then
    delete this;
  }

 private:
  void ReadNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    call_->AwaitPeer();
    StartRead(&incoming_);
  }

  // A read that is under way then fails, which voids the leases.
  void EndEarly(const absl::Status& why) {
    absl::MutexLock lock(&mutex_);
    if (end_.has_value()) return;
    if (writing_)
      return context_->TryCancel();  // the status would have to wait for a worker that may not read
    end_ = rpc::GrpcFromStatus(why);
    Continue();
  }

  absl::Status Take() {
    if (session_ != nullptr) return session_->Handle(&incoming_);
    if (!incoming_.has_hello())
      return absl::FailedPreconditionError("worker stream: the first message is not Hello");
    call_->SetSubject(incoming_.hello().name());
    absl::StatusOr<std::unique_ptr<WorkerSession>> session =
        WorkerSession::Open(coordinator_, incoming_.hello(), call_->caller(), this);
    call_->End(session.status());
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
  const AdmittedCall call_;
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
  FarmServiceAdapter(Coordinator* coordinator, AssetChecks* checks, CallGate* gate)
      : coordinator_(coordinator),
        checks_(checks),
        gate_(gate, v1::FarmService::service_full_name()),
        jobs_(coordinator) {}

  grpc::ServerUnaryReactor* FindMissingAssets(grpc::CallbackServerContext* context,
                                              const v1::FindMissingAssetsRequest* request,
                                              v1::FindMissingAssetsResponse* response) override {
    return AnswerLater(context, gate_.Admit(context, "FindMissingAssets", ""), response,
                       [&](const CallGate::Call&, Done<v1::FindMissingAssetsResponse> done) {
                         std::set<std::string> assets;
                         for (const v1::AssetRef& asset : request->assets()) assets.insert(asset.sha256());
                         checks_->Check(assets, [this, request, done](const absl::Status& checked) {
                           if (!checked.ok()) return done(checked);
                           done(coordinator_->FindMissingAssets(*request));
                         });
                       });
  }
  grpc::ServerUnaryReactor* FindUpload(grpc::CallbackServerContext* context,
                                       const v1::FindUploadRequest* request,
                                       v1::FindUploadResponse* response) override {
    return Answer(context, gate_.Admit(context, "FindUpload", request->asset().sha256()), response,
                  [&](const CallGate::Call&) { return coordinator_->FindUpload(*request); });
  }
  grpc::ServerReadReactor<v1::UploadAssetRequest>* UploadAsset(grpc::CallbackServerContext* context,
                                                               v1::UploadAssetResponse*) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "UploadAsset", "");
    if (!call.ok()) return new Refused<grpc::ServerReadReactor<v1::UploadAssetRequest>>(call.status());
    return new AssetReader(*std::move(call), coordinator_);
  }
  grpc::ServerUnaryReactor* SubmitJob(grpc::CallbackServerContext* context,
                                      const v1::SubmitJobRequest* request,
                                      v1::SubmitJobResponse* response) override {
    return AnswerLater(
        context, gate_.Admit(context, "SubmitJob", request->request_id()), response,
        [&](CallGate::Call& call, const Done<v1::SubmitJobResponse>& done) { Submit(call, *request, done); });
  }
  grpc::ServerUnaryReactor* GetJob(grpc::CallbackServerContext* context, const v1::GetJobRequest* request,
                                   v1::JobStatus* response) override {
    return AnswerOfJob(context, "GetJob", *request, response,
                       [&] { return coordinator_->GetJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context, const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override {
    return Answer(context, gate_.Admit(context, "ListJobs", ""), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<v1::ListJobsResponse> {
                    const std::optional<v1::ListJobsRequest> own = jobs_.Restrict(call.caller(), *request);
                    if (!own.has_value()) return v1::ListJobsResponse();
                    return coordinator_->ListJobs(*own);
                  });
  }
  grpc::ServerWriteReactor<v1::JobStatus>* WatchJob(grpc::CallbackServerContext* context,
                                                    const v1::WatchJobRequest* request) override {
    absl::StatusOr<AdmittedCall> call = AdmitStreamOfJob(context, "WatchJob", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::JobStatus>>(call.status());
    return new StatusWriter(*std::move(call), coordinator_, request->job_id());
  }
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request, v1::JobStatus* response) override {
    return ChangeJob(context, "CancelJob", *request, response, [&](Coordinator::StatusAnswer done) {
      coordinator_->CancelJob(request->job_id(), std::move(done));
    });
  }
  grpc::ServerUnaryReactor* RetryJob(grpc::CallbackServerContext* context, const v1::RetryJobRequest* request,
                                     v1::JobStatus* response) override {
    return ChangeJob(context, "RetryJob", *request, response, [&](Coordinator::StatusAnswer done) {
      coordinator_->RetryJob(*request, std::move(done));
    });
  }
  grpc::ServerUnaryReactor* AddSamples(grpc::CallbackServerContext* context,
                                       const v1::AddSamplesRequest* request,
                                       v1::JobStatus* response) override {
    return ChangeJob(context, "AddSamples", *request, response, [&](Coordinator::StatusAnswer done) {
      coordinator_->AddSamples(*request, std::move(done));
    });
  }
  grpc::ServerUnaryReactor* DeleteJob(grpc::CallbackServerContext* context,
                                      const v1::DeleteJobRequest* request,
                                      v1::DeleteJobResponse* response) override {
    return AnswerLater(context, gate_.Admit(context, "DeleteJob", request->job_id()), response,
                       [&](const CallGate::Call& call, Done<v1::DeleteJobResponse> done) {
                         const absl::Status own = jobs_.Check(call.caller(), request->job_id());
                         if (!own.ok()) return done(own);
                         coordinator_->DeleteJob(*request, [done](const absl::StatusOr<v1::JobStatus>& last) {
                           if (!last.ok()) return done(last.status());
                           done(v1::DeleteJobResponse());
                         });
                       });
  }
  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest*,
                                            v1::ServerStatus* response) override {
    return Answer(context, gate_.Admit(context, "GetServerStatus", ""), response,
                  [&](const CallGate::Call&) { return coordinator_->GetServerStatus(); });
  }
  grpc::ServerUnaryReactor* PauseJob(grpc::CallbackServerContext* context, const v1::PauseJobRequest* request,
                                     v1::JobStatus* response) override {
    return AnswerOfJob(context, "PauseJob", *request, response,
                       [&] { return coordinator_->PauseJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* context,
                                      const v1::ResumeJobRequest* request, v1::JobStatus* response) override {
    return AnswerOfJob(context, "ResumeJob", *request, response,
                       [&] { return coordinator_->ResumeJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* SetJobPriority(grpc::CallbackServerContext* context,
                                           const v1::SetJobPriorityRequest* request,
                                           v1::JobStatus* response) override {
    return AnswerOfJob(context, "SetJobPriority", *request, response,
                       [&] { return coordinator_->SetJobPriority(*request); });
  }
  grpc::ServerUnaryReactor* ExplainJob(grpc::CallbackServerContext* context,
                                       const v1::ExplainJobRequest* request,
                                       v1::ExplainJobResponse* response) override {
    return AnswerOfJob(context, "ExplainJob", *request, response,
                       [&] { return coordinator_->ExplainJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* ListWorkers(grpc::CallbackServerContext* context,
                                        const v1::ListWorkersRequest* request,
                                        v1::ListWorkersResponse* response) override {
    return Answer(context, gate_.Admit(context, "ListWorkers", ""), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<v1::ListWorkersResponse> {
                    absl::StatusOr<v1::ListWorkersResponse> workers = coordinator_->ListWorkers(*request);
                    if (!workers.ok()) return workers;
                    return jobs_.Shown(call.caller(), *std::move(workers));
                  });
  }
  grpc::ServerUnaryReactor* DrainWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return Answer(context, gate_.Admit(context, "DrainWorker", request->worker()), response,
                  [&](const CallGate::Call&) { return coordinator_->DrainWorker(*request); });
  }
  grpc::ServerUnaryReactor* BlockWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return Answer(context, gate_.Admit(context, "BlockWorker", request->worker()), response,
                  [&](const CallGate::Call&) { return coordinator_->BlockWorker(*request); });
  }
  grpc::ServerUnaryReactor* ReadmitWorker(grpc::CallbackServerContext* context,
                                          const v1::WorkerRequest* request,
                                          v1::WorkerStatus* response) override {
    return Answer(context, gate_.Admit(context, "ReadmitWorker", request->worker()), response,
                  [&](const CallGate::Call&) { return coordinator_->ReadmitWorker(*request); });
  }
  grpc::ServerUnaryReactor* GetLog(grpc::CallbackServerContext* context, const v1::GetLogRequest* request,
                                   v1::GetLogResponse* response) override {
    return Answer(context, gate_.Admit(context, "GetLog", absl::StrCat(request->job_id(), request->worker())),
                  response, [&](const CallGate::Call& call) -> absl::StatusOr<v1::GetLogResponse> {
                    const absl::Status own = jobs_.CheckLog(call.caller(), *request);
                    if (!own.ok()) return own;
                    return coordinator_->GetLog(*request);
                  });
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* DownloadResult(grpc::CallbackServerContext* context,
                                                          const v1::DownloadResultRequest* request) override {
    absl::StatusOr<AdmittedCall> call = AdmitStreamOfJob(context, "DownloadResult", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::ByteChunk>>(call.status());
    auto* writer = new FileWriter(*std::move(call));
    writer->Start(coordinator_->OpenResult(*request));
    return writer;
  }

 private:
  /// A call about one job, which must be the caller's.
  template <typename Request, typename Response, typename Make>
  grpc::ServerUnaryReactor* AnswerOfJob(grpc::CallbackServerContext* context, const char* method,
                                        const Request& request, Response* response, Make make) {
    return Answer(context, gate_.Admit(context, method, request.job_id()), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<Response> {
                    const absl::Status own = jobs_.Check(call.caller(), request.job_id());
                    if (!own.ok()) return own;
                    return make();
                  });
  }

  /// A change of one job, which is answered later.
  template <typename Request, typename Start>
  grpc::ServerUnaryReactor* ChangeJob(grpc::CallbackServerContext* context, const char* method,
                                      const Request& request, v1::JobStatus* response, Start start) {
    return AnswerLater(context, gate_.Admit(context, method, request.job_id()), response,
                       [&](const CallGate::Call& call, Done<v1::JobStatus> done) {
                         const absl::Status own = jobs_.Check(call.caller(), request.job_id());
                         if (!own.ok()) return done(own);
                         start(std::move(done));
                       });
  }

  absl::StatusOr<AdmittedCall> AdmitStreamOfJob(grpc::CallbackServerContext* context, const char* method,
                                                const std::string& job_id) {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, method, job_id);
    if (!call.ok()) return call;
    absl::Status own = jobs_.Check((*call)->caller(), job_id);
    if (own.ok()) return call;
    (*call)->End(own);
    return own;
  }

  void Submit(CallGate::Call& call, const v1::SubmitJobRequest& request,
              const Done<v1::SubmitJobResponse>& done) {
    absl::StatusOr<v1::SubmitJobRequest> claimed = jobs_.Claim(call.caller(), request);
    if (!claimed.ok()) return done(claimed.status());
    const auto own = std::make_shared<v1::SubmitJobRequest>(*std::move(claimed));
    std::set<std::string> assets = {own->spec().scene().file().sha256()};
    for (const v1::AssetRef& asset : own->spec().scene().dependencies()) assets.insert(asset.sha256());
    checks_->Check(assets, [this, own, &call, done](const absl::Status& checked) {
      if (!checked.ok()) return done(checked);
      absl::StatusOr<v1::SubmitJobResponse> submitted = coordinator_->SubmitJob(*own);
      if (submitted.ok()) call.SetSubject(submitted->job_id());  // `done` keeps the call
      done(std::move(submitted));
    });
  }

  Coordinator* const coordinator_;
  AssetChecks* const checks_;
  const ServiceGate gate_;
  const JobAccess jobs_;
};

class WorkerServiceAdapter final : public v1::WorkerService::CallbackService {
 public:
  WorkerServiceAdapter(Coordinator* coordinator, AssetChecks* checks, CallGate* gate)
      : coordinator_(coordinator), checks_(checks), gate_(gate, v1::WorkerService::service_full_name()) {}

  grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>* Work(
      grpc::CallbackServerContext* context) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "Work", "");
    if (!call.ok())
      return new Refused<grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>>(call.status());
    return new WorkStream(context, *std::move(call), coordinator_);
  }
  grpc::ServerUnaryReactor* FetchSpec(grpc::CallbackServerContext* context,
                                      const v1::FetchSpecRequest* request, v1::JobSpec* response) override {
    return Answer(context, gate_.Admit(context, "FetchSpec", request->job_id()), response,
                  [&](const CallGate::Call& call) {
                    return coordinator_->FetchSpec(*request, access::KeyOf(call.caller()));
                  });
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* FetchAsset(grpc::CallbackServerContext* context,
                                                      const v1::FetchAssetRequest* request) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "FetchAsset", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::ByteChunk>>(call.status());
    absl::Status allowed = coordinator_->CheckFetch(*request, access::KeyOf((*call)->caller()));
    auto* writer = new FileWriter(*std::move(call));
    if (!allowed.ok()) {
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
  const ServiceGate gate_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator, AssetChecks* checks,
                                                         CallGate* gate) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(std::make_unique<FarmServiceAdapter>(coordinator, checks, gate));
  services.push_back(std::make_unique<WorkerServiceAdapter>(coordinator, checks, gate));
  return services;
}

}  // namespace lumifold::server
