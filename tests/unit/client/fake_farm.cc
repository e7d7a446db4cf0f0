#include "tests/unit/client/fake_farm.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <thread>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::client {
namespace {

// Smaller than the protocol's limit, so that small files have many pieces.
constexpr uint64_t kPieceBytes = 1000;

grpc::Status NoSuchJob(const std::string& job_id) {
  return {grpc::StatusCode::NOT_FOUND, absl::StrCat("no job '", job_id, "'")};
}

}  // namespace

FakeFarm::FakeFarm() {
  int port = 0;
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
  LUMIFOLD_CHECK(server_ != nullptr);
  address_ = absl::StrCat("127.0.0.1:", port);
}

FakeFarm::~FakeFarm() { server_->Shutdown(std::chrono::system_clock::now()); }

std::shared_ptr<grpc::Channel> FakeFarm::channel() const {
  return rpc::MakeChannel(address_, rpc::Security{});
}

std::vector<std::string> FakeFarm::uploads() const {
  const std::lock_guard lock(mutex_);
  return uploads_;
}

std::vector<uint64_t> FakeFarm::upload_offsets() const {
  const std::lock_guard lock(mutex_);
  return upload_offsets_;
}

void FakeFarm::KeepUpload(const std::string& sha256, const std::string& content) {
  const std::lock_guard lock(mutex_);
  kept_[sha256] = content;
}

std::vector<v1::SubmitJobRequest> FakeFarm::submissions() const {
  const std::lock_guard lock(mutex_);
  return submissions_;
}

std::vector<uint64_t> FakeFarm::download_offsets() const {
  const std::lock_guard lock(mutex_);
  return download_offsets_;
}

std::vector<std::string> FakeFarm::cancelled() const {
  const std::lock_guard lock(mutex_);
  return cancelled_;
}

grpc::Status FakeFarm::FindMissingAssets(grpc::ServerContext*, const v1::FindMissingAssetsRequest* request,
                                         v1::FindMissingAssetsResponse* response) {
  const std::lock_guard lock(mutex_);
  for (const v1::AssetRef& asset : request->assets()) {
    if (!assets_.contains(asset.sha256())) response->add_missing_sha256(asset.sha256());
  }
  return grpc::Status::OK;
}

grpc::Status FakeFarm::FindUpload(grpc::ServerContext*, const v1::FindUploadRequest* request,
                                  v1::FindUploadResponse* response) {
  const std::lock_guard lock(mutex_);
  const auto kept = kept_.find(request->asset().sha256());
  if (kept != kept_.end()) response->set_received_bytes(kept->second.size());
  return grpc::Status::OK;
}

grpc::Status FakeFarm::UploadAsset(grpc::ServerContext*, grpc::ServerReader<v1::UploadAssetRequest>* reader,
                                   v1::UploadAssetResponse*) {
  v1::UploadAssetRequest request;
  std::string content;
  std::string sha256;
  std::optional<uint64_t> first;
  uint64_t stop = std::numeric_limits<uint64_t>::max();
  while (content.size() < stop && reader->Read(&request)) {
    if (request.has_announce()) sha256 = request.announce().sha256();
    if (!request.has_chunk()) continue;
    if (rpc::Checksum(request.chunk().data()) != request.chunk().checksum()) {
      return {grpc::StatusCode::DATA_LOSS, "checksum"};
    }
    if (!first.has_value()) {
      first = request.chunk().offset();
      const std::lock_guard lock(mutex_);
      if (upload_offsets_.size() < break_uploads.size()) stop = break_uploads[upload_offsets_.size()];
      upload_offsets_.push_back(*first);
      content = kept_[sha256].substr(0, *first);
    }
    if (content.size() < stop) content.append(request.chunk().data(), 0, stop - content.size());
  }
  const std::lock_guard lock(mutex_);
  if (content.size() >= stop) {
    kept_[sha256] = content;
    return {grpc::StatusCode::UNAVAILABLE, "broken by the test"};
  }
  kept_.erase(sha256);
  if (rpc::Sha256Hex(content) != sha256) return {grpc::StatusCode::DATA_LOSS, "SHA-256"};
  assets_[sha256] = content;
  uploads_.push_back(content);
  return grpc::Status::OK;
}

grpc::Status FakeFarm::SubmitJob(grpc::ServerContext* context, const v1::SubmitJobRequest* request,
                                 v1::SubmitJobResponse* response) {
  const std::lock_guard lock(mutex_);
  if (!submit_error.empty()) return {grpc::StatusCode::INVALID_ARGUMENT, submit_error};
  submissions_.push_back(*request);
  submissions_.back().mutable_scheduling()->set_trace_id(rpc::TraceIdOf(rpc::SentTraceParent(*context)));
  response->set_job_id("job-1");
  return grpc::Status::OK;
}

grpc::Status FakeFarm::GetJob(grpc::ServerContext*, const v1::GetJobRequest* request, v1::JobStatus* job) {
  const auto found = jobs.find(request->job_id());
  if (found == jobs.end()) return NoSuchJob(request->job_id());
  *job = found->second;
  return grpc::Status::OK;
}

grpc::Status FakeFarm::ListJobs(grpc::ServerContext*, const v1::ListJobsRequest* request,
                                v1::ListJobsResponse* response) {
  Record("ListJobs", *request);
  for (auto job = jobs.upper_bound(request->page_token()); job != jobs.end(); ++job) {
    if (response->jobs_size() == std::min(page_jobs, request->limit())) {
      response->set_next_page_token(response->jobs().rbegin()->job_id());
      break;
    }
    *response->add_jobs() = job->second;
  }
  return grpc::Status::OK;
}

grpc::Status FakeFarm::WatchJob(grpc::ServerContext* context, const v1::WatchJobRequest* request,
                                grpc::ServerWriter<v1::JobStatus>* writer) {
  if (watched.empty()) return NoSuchJob(request->job_id());
  for (size_t i = 0; i < watched_per_stream && next_watched_ < watched.size(); ++i) {
    writer->Write(watched[next_watched_++]);
  }
  while (hold_watch && !context->IsCancelled()) std::this_thread::yield();
  if (next_watched_ < watched.size()) return {broken_watch, "broken by the test"};
  return grpc::Status::OK;
}

grpc::Status FakeFarm::CancelJob(grpc::ServerContext*, const v1::CancelJobRequest* request,
                                 v1::JobStatus* job) {
  const std::lock_guard lock(mutex_);
  cancelled_.push_back(request->job_id());
  job->set_job_id(request->job_id());
  job->set_state(v1::JOB_STATE_CANCELLED);
  return grpc::Status::OK;
}

std::vector<std::string> FakeFarm::calls() const {
  const std::lock_guard lock(mutex_);
  return calls_;
}

grpc::Status FakeFarm::Record(const std::string& call, const google::protobuf::Message& request) {
  const std::lock_guard lock(mutex_);
  calls_.push_back(absl::StrCat(call, " ", request.ShortDebugString()));
  return grpc::Status::OK;
}

template <typename Request>
grpc::Status FakeFarm::ChangeJob(const std::string& call, const Request& request, v1::JobStatus* job) {
  Record(call, request);
  v1::GetJobRequest get;
  get.set_job_id(request.job_id());
  return GetJob(nullptr, &get, job);
}

grpc::Status FakeFarm::ChangeWorker(const std::string& call, const v1::WorkerRequest& request,
                                    v1::WorkerState state, v1::WorkerStatus* worker) {
  Record(call, request);
  worker->set_name(request.worker());
  worker->set_state(state);
  return grpc::Status::OK;
}

grpc::Status FakeFarm::PauseJob(grpc::ServerContext*, const v1::PauseJobRequest* request,
                                v1::JobStatus* job) {
  return ChangeJob("PauseJob", *request, job);
}
grpc::Status FakeFarm::ResumeJob(grpc::ServerContext*, const v1::ResumeJobRequest* request,
                                 v1::JobStatus* job) {
  return ChangeJob("ResumeJob", *request, job);
}
grpc::Status FakeFarm::SetJobPriority(grpc::ServerContext*, const v1::SetJobPriorityRequest* request,
                                      v1::JobStatus* job) {
  return ChangeJob("SetJobPriority", *request, job);
}
grpc::Status FakeFarm::DeleteJob(grpc::ServerContext*, const v1::DeleteJobRequest* request,
                                 v1::DeleteJobResponse*) {
  v1::JobStatus job;
  return ChangeJob("DeleteJob", *request, &job);
}
grpc::Status FakeFarm::RetryJob(grpc::ServerContext*, const v1::RetryJobRequest* request,
                                v1::JobStatus* job) {
  return ChangeJob("RetryJob", *request, job);
}
grpc::Status FakeFarm::AddSamples(grpc::ServerContext*, const v1::AddSamplesRequest* request,
                                  v1::JobStatus* job) {
  return ChangeJob("AddSamples", *request, job);
}
grpc::Status FakeFarm::ExplainJob(grpc::ServerContext*, const v1::ExplainJobRequest* request,
                                  v1::ExplainJobResponse* response) {
  response->mutable_reasons()->Assign(reasons.begin(), reasons.end());
  return ChangeJob("ExplainJob", *request, response->mutable_status());
}

grpc::Status FakeFarm::ListWorkers(grpc::ServerContext*, const v1::ListWorkersRequest* request,
                                   v1::ListWorkersResponse* response) {
  Record("ListWorkers", *request);
  const size_t next = request->page_token().size();
  if (next < workers.size()) *response->add_workers() = workers[next];
  if (next + 1 < workers.size()) response->set_next_page_token(request->page_token() + "x");
  return grpc::Status::OK;
}
grpc::Status FakeFarm::DrainWorker(grpc::ServerContext*, const v1::WorkerRequest* request,
                                   v1::WorkerStatus* worker) {
  return ChangeWorker("DrainWorker", *request, v1::WORKER_STATE_DRAINING, worker);
}
grpc::Status FakeFarm::BlockWorker(grpc::ServerContext*, const v1::WorkerRequest* request,
                                   v1::WorkerStatus* worker) {
  return ChangeWorker("BlockWorker", *request, v1::WORKER_STATE_BLOCKED, worker);
}
grpc::Status FakeFarm::ReadmitWorker(grpc::ServerContext*, const v1::WorkerRequest* request,
                                     v1::WorkerStatus* worker) {
  return ChangeWorker("ReadmitWorker", *request, v1::WORKER_STATE_IDLE, worker);
}
grpc::Status FakeFarm::GetLog(grpc::ServerContext*, const v1::GetLogRequest* request,
                              v1::GetLogResponse* response) {
  response->mutable_events()->Assign(events.begin(), events.end());
  return Record("GetLog", *request);
}
grpc::Status FakeFarm::GetUsage(grpc::ServerContext*, const v1::GetUsageRequest* request,
                                v1::GetUsageResponse* response) {
  for (const char* user : {"ann", "ben", "ann"}) {
    v1::JobUsage* const job = response->add_jobs();
    job->set_job_id(absl::StrCat("job-", response->jobs_size()));
    job->set_user(user);
    job->set_units(10);
    job->set_render_seconds(5400);
    job->set_frames(2);
    job->set_finish_seconds(1800);
  }
  return Record("GetUsage", *request);
}
grpc::Status FakeFarm::GetServerStatus(grpc::ServerContext*, const v1::GetServerStatusRequest* request,
                                       v1::ServerStatus* status) {
  *status = server_status;
  return Record("GetServerStatus", *request);
}

grpc::Status FakeFarm::GetPreview(grpc::ServerContext*, const v1::GetPreviewRequest* request,
                                  v1::Preview* answer) {
  Record("GetPreview", *request);
  if (preview.units() <= request->newer_than_units())
    return {grpc::StatusCode::FAILED_PRECONDITION, "job job-1 has ended without frame 0"};
  *answer = preview;
  return grpc::Status::OK;
}

grpc::Status FakeFarm::DownloadResult(grpc::ServerContext*, const v1::DownloadResultRequest* request,
                                      grpc::ServerWriter<v1::ByteChunk>* writer) {
  if (result.empty()) return NoSuchJob(request->job_id());
  uint64_t stop = result.size();
  std::string sent = result;
  {
    const std::lock_guard lock(mutex_);
    const size_t call = download_offsets_.size();
    download_offsets_.push_back(request->offset());
    if (call < break_downloads.size()) stop = break_downloads[call];
    if (call < sent_results.size()) sent = sent_results[call];
  }
  if (request->offset() > result.size()) return {grpc::StatusCode::OUT_OF_RANGE, "past the end"};
  uint64_t offset = request->offset();
  if (stop <= offset && stop < result.size()) return {grpc::StatusCode::UNAVAILABLE, "broken by the test"};
  do {
    v1::ByteChunk chunk;
    chunk.set_offset(offset);
    if (offset == request->offset())
      chunk.set_sha256(stated_sha256.empty() ? rpc::Sha256Hex(result) : stated_sha256);
    chunk.set_data(sent.substr(offset, std::min(kPieceBytes, stop - offset)));
    chunk.set_checksum(rpc::Checksum(chunk.data()));
    chunk.set_total_size(result.size());
    writer->Write(chunk);
    offset += chunk.data().size();
  } while (offset < stop);
  if (stop < result.size()) return {grpc::StatusCode::UNAVAILABLE, "broken by the test"};
  return grpc::Status::OK;
}

}  // namespace lumifold::client
