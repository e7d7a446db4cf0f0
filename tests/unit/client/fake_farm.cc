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

grpc::Status FakeFarm::SubmitJob(grpc::ServerContext*, const v1::SubmitJobRequest* request,
                                 v1::SubmitJobResponse* response) {
  const std::lock_guard lock(mutex_);
  if (!submit_error.empty()) return {grpc::StatusCode::INVALID_ARGUMENT, submit_error};
  submissions_.push_back(*request);
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
  for (const auto& [id, job] : jobs) {
    if (response->jobs_size() < request->limit()) *response->add_jobs() = job;
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
  if (next_watched_ < watched.size()) return {grpc::StatusCode::UNAVAILABLE, "broken by the test"};
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
