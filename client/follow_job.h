#pragma once

#include <functional>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "client/backoff.h"
#include "client/farm_client.h"
#include "client/progress.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// A job's status as one stage of work.
ProgressState ProgressOf(const v1::JobStatus& job);

/// Follows a job to its end and gives its last status. `on_status` hears each status; `progress` shows them,
/// and the job's warnings once each. A connection that breaks after it stood is opened anew as long as
/// `backoff` allows; one that never stood is an error at once. Errors: as FarmClient's.
absl::StatusOr<v1::JobStatus> FollowJob(FarmClient& farm, const std::string& job_id, Progress& progress,
                                        Backoff backoff,
                                        absl::FunctionRef<void(const v1::JobStatus&)> on_status);

}  // namespace lumifold::client
