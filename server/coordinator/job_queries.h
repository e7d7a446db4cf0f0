#pragma once

#include <cstdint>
#include <string>

#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

namespace lumifold::server {

/// Answers about jobs: from memory for those that are active, from the ledger for those that have ended.
/// Threads: safe.
class JobQueries final : public JobApi {
 public:
  /// Both must outlive it.
  JobQueries(const Resources* resources, FarmState* state) : resources_(resources), state_(state) {}

  absl::StatusOr<v1::JobStatus> GetJob(const std::string& job_id) override;
  absl::StatusOr<std::string> UserOf(const std::string& job_id) override;
  absl::StatusOr<v1::ListJobsResponse> ListJobs(const v1::ListJobsRequest& request) override;
  absl::StatusOr<v1::ExplainJobResponse> ExplainJob(const std::string& job_id) override;
  absl::StatusOr<rpc::ByteSender> OpenResult(const v1::DownloadResultRequest& request) override;
  absl::Status Watch(const std::string& job_id, JobWatcher* watcher) override;
  void Unwatch(JobWatcher* watcher) override;
  absl::StatusOr<v1::ServerStatus> GetServerStatus() override;
  absl::StatusOr<v1::GetUsageResponse> GetUsage(const v1::GetUsageRequest& request) override;
  absl::StatusOr<v1::GetLogResponse> GetLog(const v1::GetLogRequest& request) override;

  /// Committed units of a job, for previews of one of its frames. Errors: those of GetPreview about the job
  /// and the frame.
  absl::StatusOr<int64_t> CountUnits(const job::JobId& job, int32_t frame);
  absl::StatusOr<v1::JobStatus> StatusOf(const job::JobId& job);
  /// The epoch that a job belongs to. Errors: those of JobStore::GetJob.
  absl::StatusOr<ledger::Epoch> OwnerOf(const job::JobId& job);
  /// Of a job that was not in memory. Errors: kUnavailable for one that has not ended: it is between two
  /// coordinators.
  static absl::Status CheckHasEnded(const v1::JobStatus& status);

 private:
  /// Adds the jobs of a page that the request asks for.
  absl::Status AddListed(const ledger::JobPage& page, const v1::ListJobsRequest& request,
                         v1::ListJobsResponse* response);
  /// The job's plan; without decisions if it has none. Errors: those of the ledger.
  absl::StatusOr<v1::Plan> PlanOf(const job::JobId& job);
  /// Whether the frame's result is written. Errors: kNotFound; those of the ledger.
  absl::StatusOr<bool> IsFinished(const job::JobId& job, int32_t frame);

  const Resources* const resources_;
  FarmState* const state_;
};

}  // namespace lumifold::server
