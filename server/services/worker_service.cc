#include "server/services/worker_service.h"

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/status_codec.h"
#include "server/access/identity.h"
#include "server/assets/asset_checks.h"
#include "server/coordinator/roles.h"
#include "server/metrics/traffic.h"
#include "server/services/call_gate.h"
#include "server/services/farm_service.h"
#include "server/services/file_reader.h"
#include "server/services/file_writer.h"
#include "server/services/unary_calls.h"
#include "server/services/worker_session.h"

// A reactor exists from the start of its call to OnDone, where it deletes itself.

namespace lumifold::server {
namespace {

/// A worker that lets more than this wait is disconnected. A worker that reads has at most some grants of 256
/// leases (25 KiB each) and an acknowledgement for each of its up to 1024 slots before it.
constexpr size_t kMaxOutgoingMessages = 8192;
constexpr size_t kMaxOutgoingBytes = size_t{4} << 20;

/// The stream of a worker. The coordinator calls Send while it holds its own lock, so mutex_ is never held
/// during a call to the coordinator.
class WorkStream final : public grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>,
                         public WorkerSink {
 public:
  WorkStream(grpc::CallbackServerContext* context, AdmittedCall call, WorkerApi* workers)
      : context_(context), call_(std::move(call)), workers_(workers) {
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
        WorkerSession::Open(workers_, incoming_.hello(), call_->caller(), this);
    absl::Status status = session.status();
    call_->End(status);
    if (session.ok()) session_ = *std::move(session);
    return status;
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
  WorkerApi* const workers_;
  v1::WorkerMessage incoming_;
  std::unique_ptr<WorkerSession> session_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  std::deque<v1::CoordinatorMessage> outgoing_ ABSL_GUARDED_BY(mutex_);
  size_t outgoing_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<grpc::Status> end_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool broken_ ABSL_GUARDED_BY(mutex_) = false;
};

/// A result that a worker delivers.
class ResultTarget {
 public:
  ResultTarget(WorkerApi* workers, std::string caller) : workers_(workers), caller_(std::move(caller)) {}

  static std::string SubjectOf(const v1::DeliverResultRequest& request) {
    return request.announce().unit().job_id();
  }
  absl::Status Announce(const v1::DeliverResultRequest& request) {
    absl::StatusOr<std::unique_ptr<ResultUpload>> upload =
        workers_->ReceiveResult(request.announce(), caller_);
    absl::Status status = upload.status();
    if (upload.ok()) upload_ = *std::move(upload);
    return status;
  }
  absl::Status Add(const v1::ByteChunk& chunk) { return upload_->Add(chunk); }
  absl::Status Finish() { return upload_->Finish(); }

 private:
  WorkerApi* const workers_;
  const std::string caller_;
  std::unique_ptr<ResultUpload> upload_;
};

class WorkerServiceAdapter final : public v1::WorkerService::CallbackService {
 public:
  WorkerServiceAdapter(WorkerApi* workers, Traffic* traffic, AssetChecks* checks, CallGate* gate)
      : workers_(workers),
        traffic_(traffic),
        checks_(checks),
        gate_(gate, v1::WorkerService::service_full_name()) {}

  grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>* Work(
      grpc::CallbackServerContext* context) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "Work", "");
    if (!call.ok())
      return new Refused<grpc::ServerBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>>(call.status());
    return new WorkStream(context, *std::move(call), workers_);
  }
  grpc::ServerUnaryReactor* FetchSpec(grpc::CallbackServerContext* context,
                                      const v1::FetchSpecRequest* request, v1::JobSpec* response) override {
    return Answer(context, gate_.Admit(context, "FetchSpec", request->job_id()), response,
                  [&](const CallGate::Call& call) {
                    return workers_->FetchSpec(*request, access::KeyOf(call.caller()));
                  });
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* FetchAsset(grpc::CallbackServerContext* context,
                                                      const v1::FetchAssetRequest* request) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "FetchAsset", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::ByteChunk>>(call.status());
    absl::Status allowed = workers_->CheckFetch(*request, access::KeyOf((*call)->caller()));
    auto* writer = new FileWriter<rpc::ByteSender>(*std::move(call), &traffic_->assets_sent);
    if (!allowed.ok()) {
      writer->Start(std::move(allowed));
      return writer;
    }
    checks_->Check({request->sha256()}, [this, request, writer](const absl::Status& checked) {
      writer->Start(checked.ok() ? workers_->OpenAsset(*request) : checked);
    });
    return writer;
  }

  grpc::ServerWriteReactor<v1::ByteChunk>* FetchUnits(grpc::CallbackServerContext* context,
                                                      const v1::FetchUnitsRequest* request) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "FetchUnits", request->unit().job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::ByteChunk>>(call.status());
    const std::string caller = access::KeyOf((*call)->caller());
    auto* writer = new FileWriter<UnitSender>(*std::move(call), &traffic_->units_sent);
    writer->Start(workers_->OpenUnits(*request, caller));
    return writer;
  }
  grpc::ServerReadReactor<v1::DeliverResultRequest>* DeliverResult(grpc::CallbackServerContext* context,
                                                                   v1::DeliverResultResponse*) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "DeliverResult", "");
    if (!call.ok()) return new Refused<grpc::ServerReadReactor<v1::DeliverResultRequest>>(call.status());
    ResultTarget target(workers_, access::KeyOf((*call)->caller()));
    return new FileReader<v1::DeliverResultRequest, ResultTarget>(*std::move(call), std::move(target));
  }

 private:
  WorkerApi* const workers_;
  Traffic* const traffic_;
  AssetChecks* const checks_;
  const ServiceGate gate_;
};

}  // namespace

std::vector<std::unique_ptr<grpc::Service>> MakeServices(const ServiceParts& parts) {
  std::vector<std::unique_ptr<grpc::Service>> services;
  services.push_back(MakeFarmService(parts));
  services.push_back(
      std::make_unique<WorkerServiceAdapter>(parts.workers, parts.traffic, parts.checks, parts.gate));
  return services;
}

}  // namespace lumifold::server
