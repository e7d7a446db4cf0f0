#include "server/services/farm_service.h"

#include <algorithm>
#include <functional>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/trace_context.h"
#include "server/access/identity.h"
#include "server/assets/asset_checks.h"
#include "server/cluster/farm_peers.h"
#include "server/coordinator/roles.h"
#include "server/job/job_spec.h"
#include "server/metrics/traffic.h"
#include "server/preview/preview_maker.h"
#include "server/services/call_gate.h"
#include "server/services/farm_streams.h"
#include "server/services/file_writer.h"
#include "server/services/job_access.h"
#include "server/services/unary_calls.h"

namespace lumifold::server {
namespace {

void AddMembers(const std::vector<ledger::Member>& members, v1::ServerStatus* status) {
  for (const ledger::Member& member : members) {
    v1::CoordinatorStatus* coordinator = status->add_coordinators();
    coordinator->set_name(member.owner.name);
    coordinator->set_address(member.address);
    coordinator->set_epoch(member.owner.epoch.value());
    coordinator->set_active_jobs(member.active_jobs);
    coordinator->set_workers(static_cast<int32_t>(member.workers));
    coordinator->set_slots(static_cast<int32_t>(member.slots));
    coordinator->set_demand(member.demand);
  }
}

/// The member whose workers a page begins with; its own token is left in the request.
absl::StatusOr<ledger::Epoch> TakeEpoch(const std::vector<ledger::Member>& members,
                                        v1::ListWorkersRequest* request) {
  const std::string token = request->page_token();
  if (token.empty()) return members.empty() ? ledger::Epoch() : members.front().owner.epoch;
  const size_t slash = token.find('/');
  int64_t epoch = 0;
  if (slash == std::string::npos || !absl::SimpleAtoi(token.substr(0, slash), &epoch))
    return absl::InvalidArgumentError("page_token is not one of this call's");
  request->set_page_token(token.substr(slash + 1));
  return ledger::Epoch(epoch);
}

/// The token of the page after one of this member, whose own next token is `rest`.
std::string NextToken(const std::vector<ledger::Member>& members, ledger::Epoch epoch,
                      const std::string& rest) {
  if (!rest.empty()) return absl::StrCat(epoch.value(), "/", rest);
  const auto next = std::find_if(members.begin(), members.end(), [epoch](const ledger::Member& member) {
    return member.owner.epoch > epoch;
  });
  return next == members.end() ? "" : absl::StrCat(next->owner.epoch.value(), "/");
}

/// The calls that only give figures.
class FiguresAdapter : public v1::FarmService::CallbackService {
 public:
  explicit FiguresAdapter(const ServiceParts& parts)
      : parts_(parts), gate_(parts.gate, v1::FarmService::service_full_name()), job_access_(parts.jobs) {}

  grpc::ServerUnaryReactor* GetServerStatus(grpc::CallbackServerContext* context,
                                            const v1::GetServerStatusRequest*,
                                            v1::ServerStatus* response) override {
    return Answer(context, gate_.Admit(context, "GetServerStatus", ""), response,
                  [&](const CallGate::Call&) -> absl::StatusOr<v1::ServerStatus> {
                    absl::StatusOr<v1::ServerStatus> status = parts_.jobs->GetServerStatus();
                    if (status.ok()) AddMembers(parts_.peers->Members(), &*status);
                    return status;
                  });
  }
  grpc::ServerUnaryReactor* GetUsage(grpc::CallbackServerContext* context, const v1::GetUsageRequest* request,
                                     v1::GetUsageResponse* response) override {
    return Answer(context, gate_.Admit(context, "GetUsage", ""), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<v1::GetUsageResponse> {
                    const std::optional<v1::GetUsageRequest> own =
                        job_access_.Restrict(call.caller(), *request);
                    if (!own.has_value()) return v1::GetUsageResponse();
                    return parts_.jobs->GetUsage(*own);
                  });
  }

 protected:
  const ServiceParts parts_;
  const ServiceGate gate_;
  const JobAccess job_access_;
};

class FarmServiceAdapter final : public FiguresAdapter {
 public:
  using FiguresAdapter::FiguresAdapter;

  grpc::ServerUnaryReactor* FindMissingAssets(grpc::CallbackServerContext* context,
                                              const v1::FindMissingAssetsRequest* request,
                                              v1::FindMissingAssetsResponse* response) override {
    return AnswerLater(context, gate_.Admit(context, "FindMissingAssets", ""), response,
                       [&](const CallGate::Call&, const Done<v1::FindMissingAssetsResponse>& done) {
                         std::set<std::string> assets;
                         for (const v1::AssetRef& asset : request->assets()) assets.insert(asset.sha256());
                         parts_.checks->Check(assets, [this, request, done](const absl::Status& checked) {
                           if (!checked.ok()) return done(checked);
                           done(parts_.submissions->FindMissingAssets(*request));
                         });
                       });
  }
  grpc::ServerUnaryReactor* FindUpload(grpc::CallbackServerContext* context,
                                       const v1::FindUploadRequest* request,
                                       v1::FindUploadResponse* response) override {
    return Answer(context, gate_.Admit(context, "FindUpload", request->asset().sha256()), response,
                  [&](const CallGate::Call&) { return parts_.submissions->FindUpload(*request); });
  }
  grpc::ServerReadReactor<v1::UploadAssetRequest>* UploadAsset(grpc::CallbackServerContext* context,
                                                               v1::UploadAssetResponse*) override {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, "UploadAsset", "");
    if (!call.ok()) return new Refused<grpc::ServerReadReactor<v1::UploadAssetRequest>>(call.status());
    AssetTarget target(parts_.submissions, parts_.traffic, (*call)->limit_key());
    return new AssetReader(*std::move(call), std::move(target));
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
    return AnswerLater(
        context, gate_.Admit(context, "GetJob", request->job_id()), response,
        [&](const CallGate::Call& call, const Done<v1::JobStatus>& done) {
          const absl::Status own = job_access_.Check(call.caller(), request->job_id());
          if (!own.ok()) return done(own);
          const auto recorded = [this, job = request->job_id(), done] { done(parts_.jobs->GetJob(job)); };
          const Done<v1::JobStatus> of_owner = [done, recorded](absl::StatusOr<v1::JobStatus> status) {
            if (absl::IsUnavailable(status.status())) return recorded();
            done(std::move(status));
          };
          // It does not wait: what is recorded is an answer.
          AtOwner<v1::GetJobRequest, v1::JobStatus>({context, gate_.PathOf("GetJob"), call.caller(), request,
                                                     of_owner, recorded, absl::InfinitePast()});
        });
  }
  grpc::ServerUnaryReactor* ListJobs(grpc::CallbackServerContext* context, const v1::ListJobsRequest* request,
                                     v1::ListJobsResponse* response) override {
    return Answer(context, gate_.Admit(context, "ListJobs", ""), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<v1::ListJobsResponse> {
                    const std::optional<v1::ListJobsRequest> own =
                        job_access_.Restrict(call.caller(), *request);
                    if (!own.has_value()) return v1::ListJobsResponse();
                    return parts_.jobs->ListJobs(*own);
                  });
  }
  grpc::ServerWriteReactor<v1::JobStatus>* WatchJob(grpc::CallbackServerContext* context,
                                                    const v1::WatchJobRequest* request) override {
    absl::StatusOr<AdmittedCall> call = AdmitStreamOfJob(context, "WatchJob", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::JobStatus>>(call.status());
    const absl::StatusOr<cluster::FarmPeers::Peer> owner = parts_.peers->OwnerOf(*context, request->job_id());
    auto* writer = new StatusWriter(*std::move(call), parts_.jobs);
    if (owner.ok() && owner->channel == nullptr) {
      writer->Watch(request->job_id());
    } else {
      writer->WatchAt(owner, *parts_.peers, *request);
    }
    return writer;
  }
  grpc::ServerUnaryReactor* CancelJob(grpc::CallbackServerContext* context,
                                      const v1::CancelJobRequest* request, v1::JobStatus* response) override {
    return AnswerOfJobLater(
        context, "CancelJob", *request, response,
        [this, request](const StatusAnswer& done) { parts_.changes->CancelJob(request->job_id(), done); });
  }
  grpc::ServerUnaryReactor* RetryJob(grpc::CallbackServerContext* context, const v1::RetryJobRequest* request,
                                     v1::JobStatus* response) override {
    return AnswerOfJobLater(
        context, "RetryJob", *request, response,
        [this, request](const StatusAnswer& done) { parts_.changes->RetryJob(*request, done); });
  }
  grpc::ServerUnaryReactor* AddSamples(grpc::CallbackServerContext* context,
                                       const v1::AddSamplesRequest* request,
                                       v1::JobStatus* response) override {
    return AnswerOfJobLater(
        context, "AddSamples", *request, response,
        [this, request](const StatusAnswer& done) { parts_.changes->AddSamples(*request, done); });
  }
  grpc::ServerUnaryReactor* DeleteJob(grpc::CallbackServerContext* context,
                                      const v1::DeleteJobRequest* request,
                                      v1::DeleteJobResponse* response) override {
    return AnswerOfJobLater(
        context, "DeleteJob", *request, response, [this, request](const Done<v1::DeleteJobResponse>& done) {
          parts_.changes->DeleteJob(*request, [done](const absl::StatusOr<v1::JobStatus>& last) {
            if (!last.ok()) return done(last.status());
            done(v1::DeleteJobResponse());
          });
        });
  }
  grpc::ServerUnaryReactor* PauseJob(grpc::CallbackServerContext* context, const v1::PauseJobRequest* request,
                                     v1::JobStatus* response) override {
    return AnswerOfJob(context, "PauseJob", *request, response,
                       [this, request] { return parts_.operators->PauseJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* ResumeJob(grpc::CallbackServerContext* context,
                                      const v1::ResumeJobRequest* request, v1::JobStatus* response) override {
    return AnswerOfJob(context, "ResumeJob", *request, response,
                       [this, request] { return parts_.operators->ResumeJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* SetJobPriority(grpc::CallbackServerContext* context,
                                           const v1::SetJobPriorityRequest* request,
                                           v1::JobStatus* response) override {
    return AnswerOfJob(context, "SetJobPriority", *request, response,
                       [this, request] { return parts_.operators->SetJobPriority(*request); });
  }
  grpc::ServerUnaryReactor* ExplainJob(grpc::CallbackServerContext* context,
                                       const v1::ExplainJobRequest* request,
                                       v1::ExplainJobResponse* response) override {
    return AnswerOfJob(context, "ExplainJob", *request, response,
                       [this, request] { return parts_.jobs->ExplainJob(request->job_id()); });
  }
  grpc::ServerUnaryReactor* ListWorkers(grpc::CallbackServerContext* context,
                                        const v1::ListWorkersRequest* request,
                                        v1::ListWorkersResponse* response) override {
    return AnswerLater(context, gate_.Admit(context, "ListWorkers", ""), response,
                       [&](const CallGate::Call& call, const Done<v1::ListWorkersResponse>& done) {
                         ListWorkersOfFarm(*context, call.caller(), *request, done);
                       });
  }
  grpc::ServerUnaryReactor* DrainWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return AnswerOfWorker(context, "DrainWorker", *request, response,
                          [&] { return parts_.operators->DrainWorker(*request); });
  }
  grpc::ServerUnaryReactor* BlockWorker(grpc::CallbackServerContext* context,
                                        const v1::WorkerRequest* request,
                                        v1::WorkerStatus* response) override {
    return AnswerOfWorker(context, "BlockWorker", *request, response,
                          [&] { return parts_.operators->BlockWorker(*request); });
  }
  grpc::ServerUnaryReactor* ReadmitWorker(grpc::CallbackServerContext* context,
                                          const v1::WorkerRequest* request,
                                          v1::WorkerStatus* response) override {
    return AnswerOfWorker(context, "ReadmitWorker", *request, response,
                          [&] { return parts_.operators->ReadmitWorker(*request); });
  }
  grpc::ServerUnaryReactor* GetLog(grpc::CallbackServerContext* context, const v1::GetLogRequest* request,
                                   v1::GetLogResponse* response) override {
    return AnswerLater(context,
                       gate_.Admit(context, "GetLog", absl::StrCat(request->job_id(), request->worker())),
                       response, [&](const CallGate::Call& call, const Done<v1::GetLogResponse>& done) {
                         const absl::Status own = job_access_.CheckLog(call.caller(), *request);
                         if (!own.ok()) return done(own);
                         if (request->job_id().empty()) {
                           return AtWorker<v1::GetLogRequest, v1::GetLogResponse>(
                               *context, gate_.PathOf("GetLog"), call.caller(), *request,
                               parts_.jobs->GetLog(*request), done);
                         }
                         AtOwner<v1::GetLogRequest, v1::GetLogResponse>(
                             {context, gate_.PathOf("GetLog"), call.caller(), request, done,
                              [this, request, done] { done(parts_.jobs->GetLog(*request)); },
                              parts_.peers->Patience(*context)});
                       });
  }
  grpc::ServerWriteReactor<v1::ByteChunk>* DownloadResult(grpc::CallbackServerContext* context,
                                                          const v1::DownloadResultRequest* request) override {
    absl::StatusOr<AdmittedCall> call = AdmitStreamOfJob(context, "DownloadResult", request->job_id());
    if (!call.ok()) return new Refused<grpc::ServerWriteReactor<v1::ByteChunk>>(call.status());
    auto* writer = new FileWriter<rpc::ByteSender>(*std::move(call), &parts_.traffic->results_sent);
    writer->Start(parts_.jobs->OpenResult(*request));
    return writer;
  }

  grpc::ServerUnaryReactor* GetPreview(grpc::CallbackServerContext* context,
                                       const v1::GetPreviewRequest* request, v1::Preview* response) override {
    return AnswerOfJobLater(
        context, "GetPreview", *request, response,
        [this, request](const Done<v1::Preview>& done) { parts_.previews->Get(*request, done); });
  }

  grpc::ServerUnaryReactor* CreatePageLink(grpc::CallbackServerContext* context,
                                           const v1::CreatePageLinkRequest* request,
                                           v1::PageLink* response) override {
    return Answer(context, gate_.Admit(context, "CreatePageLink", request->job_id()), response,
                  [&](const CallGate::Call& call) -> absl::StatusOr<v1::PageLink> {
                    if (!request->job_id().empty()) {
                      if (absl::Status status = job_access_.Check(call.caller(), request->job_id());
                          !status.ok())
                        return status;
                    }
                    return parts_.make_link(call.caller().id, *request);
                  });
  }

 private:
  /// A call about one job, which must be the caller's. Its owner answers it.
  template <typename Request, typename Response, typename Make>
  grpc::ServerUnaryReactor* AnswerOfJob(grpc::CallbackServerContext* context, const char* method,
                                        const Request& request, Response* response, Make make) {
    return AnswerOfJobLater(context, method, request, response,
                            [make](const Done<Response>& done) { done(absl::StatusOr<Response>(make())); });
  }

  /// The same for a call whose result comes later.
  template <typename Request, typename Response, typename Start>
  grpc::ServerUnaryReactor* AnswerOfJobLater(grpc::CallbackServerContext* context, const char* method,
                                             const Request& request, Response* response, Start start) {
    return AnswerLater(
        context, gate_.Admit(context, method, request.job_id()), response,
        [&](const CallGate::Call& call, const Done<Response>& done) {
          const absl::Status own = job_access_.Check(call.caller(), request.job_id());
          if (!own.ok()) return done(own);
          AtOwner<Request, Response>({context, gate_.PathOf(method), call.caller(), &request, done,
                                      [start, done] { start(done); }, parts_.peers->Patience(*context)});
        });
  }

  /// A call about a job.
  template <typename Request, typename Response>
  struct JobCall {
    const grpc::CallbackServerContext* context;
    std::string path;
    access::Identity caller;
    const Request* request;
    Done<Response> done;
    std::function<void()> here;
    absl::Time end;
  };
  /// Forwards a call to another coordinator that owns the job, or calls `here`. If the owner is lost, another
  /// one takes the job over: the call is tried again until `end`.
  template <typename Request, typename Response>
  void AtOwner(const JobCall<Request, Response>& call) {
    const absl::StatusOr<cluster::FarmPeers::Peer> owner =
        parts_.peers->OwnerOf(*call.context, call.request->job_id());
    if (owner.ok() && owner->channel == nullptr) return call.here();
    const auto answer = [this, call](absl::StatusOr<Response> response) {
      const bool waits = absl::IsUnavailable(response.status()) && rpc::MonotonicNow() < call.end;
      if (!waits) return call.done(std::move(response));
      cluster::FarmPeers::AfterPause([this, call] { AtOwner(call); });
    };
    if (!owner.ok()) return answer(owner.status());
    parts_.peers->Forward<Response>(*owner, call.path, *call.context, call.caller, *call.request, answer);
  }

  template <typename Make>
  grpc::ServerUnaryReactor* AnswerOfWorker(grpc::CallbackServerContext* context, const char* method,
                                           const v1::WorkerRequest& request, v1::WorkerStatus* response,
                                           Make make) {
    return AnswerLater(context, gate_.Admit(context, method, request.worker()), response,
                       [&](const CallGate::Call& call, const Done<v1::WorkerStatus>& done) {
                         AtWorker<v1::WorkerRequest, v1::WorkerStatus>(*context, gate_.PathOf(method),
                                                                       call.caller(), request, make(), done);
                       });
  }

  /// A call about a worker, whichever coordinator it is connected to: after this one, whose answer is `here`,
  /// the others are asked one after the other until one knows it.
  template <typename Request, typename Response>
  void AtWorker(const grpc::CallbackServerContext& context, const std::string& path,
                const access::Identity& caller, const Request& request, absl::StatusOr<Response> here,
                const Done<Response>& done) {
    const bool asks_others = absl::IsNotFound(here.status()) && parts_.peers->MayForward(context);
    if (!asks_others) return done(std::move(here));
    AskOthers<Request, Response>({&context, path, caller, request, here.status()}, ledger::Epoch(), done);
  }

  template <typename Request>
  struct WorkerCall {
    const grpc::CallbackServerContext* context;
    std::string path;
    access::Identity caller;
    Request request;
    /// If nobody knows the worker.
    absl::Status unknown;
  };
  /// Asks the members with epochs above `asked`.
  template <typename Request, typename Response>
  void AskOthers(const WorkerCall<Request>& call, ledger::Epoch asked, const Done<Response>& done) {
    for (const ledger::Member& member : parts_.peers->Members()) {
      if (member.owner.epoch <= asked || member.owner.epoch == parts_.epoch) continue;
      const absl::StatusOr<cluster::FarmPeers::Peer> peer = parts_.peers->PeerOf(member.owner.epoch);
      if (!peer.ok()) continue;
      return parts_.peers->Forward<Response>(
          *peer, call.path, *call.context, call.caller, call.request,
          [this, call, epoch = member.owner.epoch, done](absl::StatusOr<Response> answer) {
            if (!absl::IsNotFound(answer.status())) return done(std::move(answer));
            AskOthers<Request, Response>(call, epoch, done);
          });
    }
    done(call.unknown);
  }

  /// A page of the workers of all coordinators, one coordinator after the other. Its token is the epoch of
  /// one, a slash and that coordinator's token.
  void ListWorkersOfFarm(const grpc::CallbackServerContext& context, const access::Identity& caller,
                         const v1::ListWorkersRequest& request, const Done<v1::ListWorkersResponse>& done) {
    if (!parts_.peers->MayForward(context)) return done(ListWorkersHere(caller, request));
    const std::vector<ledger::Member> members = parts_.peers->Members();
    v1::ListWorkersRequest page = request;
    const absl::StatusOr<ledger::Epoch> epoch = TakeEpoch(members, &page);
    if (!epoch.ok()) return done(epoch.status());
    const auto add_epoch = [members, epoch = *epoch, done](absl::StatusOr<v1::ListWorkersResponse> workers) {
      if (workers.ok()) workers->set_next_page_token(NextToken(members, epoch, workers->next_page_token()));
      done(std::move(workers));
    };
    if (*epoch == parts_.epoch) return add_epoch(ListWorkersHere(caller, page));
    const absl::StatusOr<cluster::FarmPeers::Peer> peer = parts_.peers->PeerOf(*epoch);
    if (!peer.ok())
      return add_epoch(v1::ListWorkersResponse());  // it has just gone, and its workers go elsewhere
    parts_.peers->Forward<v1::ListWorkersResponse>(
        *peer, gate_.PathOf("ListWorkers"), context, caller, page,
        [add_epoch](absl::StatusOr<v1::ListWorkersResponse> workers) {
          add_epoch(absl::IsUnavailable(workers.status()) ? v1::ListWorkersResponse() : std::move(workers));
        });
  }

  absl::StatusOr<v1::ListWorkersResponse> ListWorkersHere(const access::Identity& caller,
                                                          const v1::ListWorkersRequest& request) {
    absl::StatusOr<v1::ListWorkersResponse> workers = parts_.operators->ListWorkers(request);
    if (!workers.ok()) return workers;
    return job_access_.Shown(caller, *std::move(workers));
  }

  absl::StatusOr<AdmittedCall> AdmitStreamOfJob(grpc::CallbackServerContext* context, const char* method,
                                                const std::string& job_id) {
    absl::StatusOr<AdmittedCall> call = gate_.AdmitStream(context, method, job_id);
    if (!call.ok()) return call;
    absl::Status own = job_access_.Check((*call)->caller(), job_id);
    if (own.ok()) return call;
    (*call)->End(own);
    return own;
  }

  void Submit(CallGate::Call& call, const v1::SubmitJobRequest& request,
              const Done<v1::SubmitJobResponse>& done) {
    absl::StatusOr<v1::SubmitJobRequest> claimed = job_access_.Claim(call.caller(), request);
    if (!claimed.ok()) return done(claimed.status());
    const auto own = std::make_shared<v1::SubmitJobRequest>(*std::move(claimed));
    own->mutable_scheduling()->set_trace_id(rpc::TraceIdOf(call.trace_parent()));
    parts_.checks->Check(
        job::FilesOf(own->spec().scene()), [this, own, &call, done](const absl::Status& checked) {
          if (!checked.ok()) return done(checked);
          absl::StatusOr<v1::SubmitJobResponse> submitted = parts_.submissions->SubmitJob(*own);
          if (submitted.ok()) call.SetSubject(submitted->job_id());  // `done` keeps the call
          done(std::move(submitted));
        });
  }
};

}  // namespace

std::unique_ptr<grpc::Service> MakeFarmService(const ServiceParts& parts) {
  return std::make_unique<FarmServiceAdapter>(parts);
}

}  // namespace lumifold::server
