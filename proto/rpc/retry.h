#pragma once

#include <functional>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "proto/retry/pauses.h"

namespace grpc {
class ClientContext;
}  // namespace grpc

namespace lumifold::rpc {

/// Whether a call may be repeated when it is unknown if the first try took effect.
enum class Idempotency { kIdempotent, kNotIdempotent };

/// Limits of a retry loop.
struct RetryPolicy {
  /// Deadline of each try, from its start.
  absl::Duration try_timeout = absl::Seconds(10);
  /// No try starts later than this after the first.
  absl::Duration total_timeout = absl::Seconds(60);
  int max_tries = 6;
  retry::Pauses pauses = {.first = absl::Milliseconds(100), .longest = absl::Seconds(5)};
};

/// Clock, sleep and jitter of a retry loop.
struct RetryEnvironment {
  /// Only differences of these times are used.
  std::function<absl::Time()> now;
  std::function<void(absl::Duration)> sleep;
  /// A random number in [0, 1). Shortens each pause by up to a half, so that many callers do not retry at the
  /// same time.
  std::function<double()> jitter;

  /// The monotonic clock, a real sleep and random jitter.
  static RetryEnvironment Real();
};

/// True for transient errors: kUnavailable, kAborted, kDeadlineExceeded.
bool IsTransient(const absl::Status& status);

/// Repeats `call` until it succeeds, fails with an error that is not transient, or the policy's limits are
/// reached; returns its last status. `call` sets its own deadlines: policy.try_timeout is not used.
absl::Status Retry(const RetryPolicy& policy, const RetryEnvironment& environment,
                   absl::FunctionRef<absl::Status()> call);

/// Retry of a call that gets a new context with its own deadline for each try. A call that is not idempotent
/// is made once.
absl::Status CallWithRetry(const RetryPolicy& policy, Idempotency idempotency,
                           const RetryEnvironment& environment,
                           absl::FunctionRef<absl::Status(grpc::ClientContext&)> call);

}  // namespace lumifold::rpc
