#pragma once

#include <functional>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"

namespace grpc {
class ClientContext;
}  // namespace grpc

namespace lumifold::rpc {

/// Whether a call may be made again when it is unknown if the first one took effect.
enum class Idempotency { kIdempotent, kNotIdempotent };

/// How long and how often to try.
struct RetryPolicy {
  /// Deadline of each try.
  absl::Duration try_timeout = absl::Seconds(10);
  /// No new try begins later than this after the first.
  absl::Duration total_timeout = absl::Seconds(60);
  int max_tries = 6;
  absl::Duration first_pause = absl::Milliseconds(100);
  absl::Duration max_pause = absl::Seconds(5);
};

/// The outside world of a retry loop.
struct RetryEnvironment {
  std::function<absl::Time()> now;
  std::function<void(absl::Duration)> sleep;
  /// A number in [0, 1): shortens each pause by up to a half, so that many callers do not come back all at
  /// once.
  std::function<double()> jitter;

  /// The machine's clock, a real sleep and random jitter.
  static RetryEnvironment Real();
};

/// True for errors that may pass by themselves: kUnavailable, kAborted, kDeadlineExceeded.
bool IsTransient(const absl::Status& status);

/// Makes `call` until it succeeds, fails for good, or the policy is used up; gives its last status. Each try
/// gets a fresh context with its own deadline. A call that is not idempotent is made once.
absl::Status CallWithRetry(const RetryPolicy& policy, Idempotency idempotency,
                           const RetryEnvironment& environment,
                           absl::FunctionRef<absl::Status(grpc::ClientContext&)> call);

}  // namespace lumifold::rpc
