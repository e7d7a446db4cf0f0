#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/farm.pb.h"
#include "server/access/identity.h"

namespace lumifold::server {

class JobApi;

/// What of the farm's jobs a caller reaches: a person without the scope admin, only its own. A job's owner is
/// its user.
/// Threads: safe.
class JobAccess {
 public:
  /// `jobs` must outlive it.
  explicit JobAccess(JobApi* jobs) : jobs_(jobs) {}

  /// Errors: kNotFound for a job of somebody else, as if there were none.
  absl::Status Check(const access::Identity& caller, const std::string& job_id) const;
  /// The request as a job of the caller.
  /// Errors: kPermissionDenied where it names another user; kInvalidArgument where it waits for a job that
  /// the caller does not have.
  absl::StatusOr<v1::SubmitJobRequest> Claim(const access::Identity& caller,
                                             const v1::SubmitJobRequest& request) const;
  /// The request for jobs, or usage, of the caller; nullopt where it asks for those of others only.
  std::optional<v1::ListJobsRequest> Restrict(const access::Identity& caller,
                                              const v1::ListJobsRequest& request) const;
  std::optional<v1::GetUsageRequest> Restrict(const access::Identity& caller,
                                              const v1::GetUsageRequest& request) const;
  /// Errors: kPermissionDenied for the log of a worker, which names jobs of others; those of Check.
  absl::Status CheckLog(const access::Identity& caller, const v1::GetLogRequest& request) const;
  /// Removes what the caller may not know: jobs of others, and reasons, which may name them.
  v1::ListWorkersResponse Shown(const access::Identity& caller, v1::ListWorkersResponse workers) const;

 private:
  JobApi* const jobs_;
};

}  // namespace lumifold::server
