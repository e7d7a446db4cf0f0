#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/assets.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/rpc/retry.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace lumifold::client {

/// The coordinator, as commands see it: all of gRPC is behind this.
/// Errors of every call: kUnavailable "cannot reach the coordinator at ..." when it does not answer in time;
/// kCancelled when the user interrupted; kInternal where a file on this machine is at fault; else what the
/// coordinator says (proto/lumifold/v1/farm.proto). Threads: one call at a time.
class FarmClient {
 public:
  virtual ~FarmClient() = default;

  /// SHA-256 of the scene's assets the coordinator lacks.
  virtual absl::StatusOr<std::vector<std::string>> FindMissingAssets(const v1::SceneRef& scene) = 0;

  /// Sends one file; `on_sent` hears of its bytes so far, and hears smaller ones when it is sent anew.
  virtual absl::Status UploadAsset(const LocalAsset& asset,
                                   absl::FunctionRef<void(uint64_t sent_bytes)> on_sent) = 0;

  /// The new job's id. A call repeated with one request_id makes one job.
  virtual absl::StatusOr<std::string> SubmitJob(const v1::JobSpec& spec, const std::string& request_id) = 0;

  virtual absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) = 0;
  virtual absl::StatusOr<std::vector<v1::JobStatus>> ListJobs(int limit) = 0;
  virtual absl::StatusOr<v1::JobStatus> CancelJob(const std::string& job_id) = 0;

  /// Gives each status the coordinator sends until it sends no more; calls `on_tick` several times a second
  /// between them. Not repeated when the connection breaks: whoever follows a job decides how long to be
  /// patient.
  virtual absl::Status WatchJob(const std::string& job_id,
                                absl::FunctionRef<void(const v1::JobStatus&)> on_status,
                                absl::FunctionRef<void()> on_tick) = 0;

  /// Gives each piece of a frame's file from `offset` on; an error of `on_chunk` ends the call and is its
  /// result. Not repeated either.
  virtual absl::Status DownloadResult(const std::string& job_id, int frame, uint64_t offset,
                                      absl::FunctionRef<absl::Status(const v1::ByteChunk&)> on_chunk) = 0;
};

struct FarmClientOptions {
  /// How errors call the coordinator: "127.0.0.1:7700".
  std::string coordinator;
  rpc::RetryEnvironment time;
  /// True once the user wants to stop.
  std::function<bool()> interrupted;
};

std::unique_ptr<FarmClient> MakeFarmClient(std::shared_ptr<grpc::Channel> channel, FarmClientOptions options);

/// A client of the coordinator at HOST:PORT. Connects when it is first used.
std::unique_ptr<FarmClient> ConnectTo(FarmClientOptions options);

}  // namespace lumifold::client
