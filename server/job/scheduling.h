#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// Priorities of jobs.
inline constexpr int32_t kMinPriority = -100;
inline constexpr int32_t kMaxPriority = 100;

/// Jobs that a job may wait for. Together with its tags and names its scheduling has less than 16 KiB.
inline constexpr int kMaxAfter = 64;

/// User of jobs that name none.
inline constexpr char kAnonymous[] = "anonymous";

/// Errors: kInvalidArgument.
absl::Status CheckPriority(int32_t priority);

/// Checks how a job is scheduled, and fills in the user where it is empty. Whether the jobs that it waits for
/// exist is not checked here.
/// Errors: kInvalidArgument naming the field, its value and the allowed range.
absl::StatusOr<v1::Scheduling> NormaliseScheduling(v1::Scheduling scheduling);

}  // namespace lumifold::job
