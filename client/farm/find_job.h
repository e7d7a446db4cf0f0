#pragma once

#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "client/farm/farm_client.h"

namespace lumifold::client {

/// The newest job of the user, as a name of a job.
inline constexpr char kLastJob[] = "last";

/// The id of the job that `name` means: an id, or the beginning or the end of one that no other job has; what
/// one job is called; or kLastJob, of the user whom `user` says.
/// Errors: kNotFound; kInvalidArgument where several jobs are meant, naming the newest of them; those of the
/// calls.
absl::StatusOr<std::string> FindJob(FarmClient& farm, const std::string& name,
                                    absl::FunctionRef<absl::StatusOr<std::string>()> user);

}  // namespace lumifold::client
