#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/farm/coordinators.h"
#include "client/scene/assets.h"
#include "lumifold/v1/farm.pb.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace lumifold::client {

/// The client's interface to the coordinators of a farm; hides gRPC, and which of them answers: see
/// Coordinators.
/// Errors of every call: those of Coordinators, with the coordinator's as in proto/lumifold/v1/farm.proto;
/// kInternal for errors of local files.
/// Threads: one call at a time.
class FarmClient {
 public:
  virtual ~FarmClient() = default;

  /// SHA-256 of the scene's assets that the coordinator does not have.
  virtual absl::StatusOr<std::vector<std::string>> FindMissingAssets(const v1::SceneRef& scene) = 0;

  /// How many bytes of an asset the coordinator has from an upload that broke.
  virtual absl::StatusOr<uint64_t> FindUpload(const v1::AssetRef& asset) = 0;

  /// Sends one file from `offset` on. Calls `on_sent` with the position in the file. Not retried: see
  /// client/farm/upload.h.
  virtual absl::Status UploadAsset(const LocalAsset& asset, uint64_t offset,
                                   absl::FunctionRef<void(uint64_t sent_bytes)> on_sent) = 0;

  /// Submits a job and returns its id. Repeated calls with the same request_id create one job.
  virtual absl::StatusOr<std::string> SubmitJob(const v1::SubmitJobRequest& request) = 0;

  virtual absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) = 0;
  /// One page.
  virtual absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request) = 0;
  virtual absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id) = 0;
  /// Pauses a job, or resumes it.
  virtual absl::StatusOr<v1::JobStatus> SetJobPaused(const std::string& job_id, bool paused) = 0;
  virtual absl::StatusOr<v1::JobStatus> SetJobPriority(const v1::SetJobPriorityRequest& request) = 0;
  virtual absl::Status DeleteJob(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::JobStatus> RetryJob(const v1::RetryJobRequest& request) = 0;
  virtual absl::StatusOr<v1::JobStatus> AddSamples(const std::string& job_id, int samples_per_pixel) = 0;
  virtual absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id) = 0;

  /// One page.
  virtual absl::StatusOr<v1::ListWorkersResponse> ListWorkers(const v1::ListWorkersRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> DrainWorker(const v1::WorkerRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> BlockWorker(const v1::WorkerRequest& request) = 0;
  virtual absl::StatusOr<v1::WorkerStatus> ReadmitWorker(const v1::WorkerRequest& request) = 0;
  virtual absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request) = 0;
  virtual absl::StatusOr<v1::ServerStatus> GetServerStatus() = 0;
  virtual absl::StatusOr<v1::GetUsageResponse> GetUsage(const v1::GetUsageRequest& request) = 0;
  virtual absl::StatusOr<v1::PageLink> CreatePageLink(const v1::CreatePageLinkRequest& request) = 0;
  virtual absl::StatusOr<v1::Preview> GetPreview(const v1::GetPreviewRequest& request) = 0;

  /// Calls `on_status` with each status until the stream ends, and `on_tick` several times a second. Not
  /// retried when the connection breaks: the caller decides how long to retry, which goes to the next
  /// coordinator.
  virtual absl::Status WatchJob(const std::string& job_id,
                                absl::FunctionRef<void(const v1::JobStatus&)> on_status,
                                absl::FunctionRef<void()> on_tick) = 0;

  /// Calls `on_chunk` with each piece of a frame's file from `offset` on. An error of `on_chunk` ends the
  /// call and is returned. Not retried after the first piece: the caller resumes, at the next coordinator.
  virtual absl::Status DownloadResult(const std::string& job_id, int frame, uint64_t offset,
                                      absl::FunctionRef<absl::Status(const v1::ByteChunk&)> on_chunk) = 0;
};

/// A client of one coordinator, over `channel`.
std::unique_ptr<FarmClient> MakeFarmClient(std::shared_ptr<grpc::Channel> channel, FarmClientOptions options);

/// A client of the farm. Connects on first use.
std::unique_ptr<FarmClient> ConnectTo(const FarmClientOptions& options);

}  // namespace lumifold::client
