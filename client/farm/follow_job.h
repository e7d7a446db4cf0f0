#pragma once

#include <functional>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "client/cli/progress.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// The progress of a job's current stage.
ProgressState ProgressOf(const v1::JobStatus& job);

/// Follows a job to its end and returns its last status. Calls `on_status` with each status; `progress` shows
/// them, each warning of the job once and, when nothing changes for some seconds, why. Reconnects after a
/// broken connection as long as `backoff` allows; a first connection that fails is an error at once.
/// Errors: those of FarmClient.
absl::StatusOr<v1::JobStatus> FollowJob(FarmClient& farm, const std::string& job_id, Progress& progress,
                                        Backoff backoff,
                                        absl::FunctionRef<void(const v1::JobStatus&)> on_status);

}  // namespace lumifold::client
