#include "proto/rpc/retry.h"

#include <grpcpp/client_context.h>

#include <memory>
#include <random>

#include "absl/time/clock.h"
#include "proto/retry/schedule.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::rpc {

RetryEnvironment RetryEnvironment::Real() {
  auto engine = std::make_shared<std::mt19937>(std::random_device{}());
  return {.now = MonotonicNow,
          .sleep = [](absl::Duration pause) { absl::SleepFor(pause); },
          .jitter = [engine] { return std::uniform_real_distribution<double>(0.0, 1.0)(*engine); }};
}

bool IsTransient(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsAborted(status) || absl::IsDeadlineExceeded(status);
}

absl::Status Retry(const RetryPolicy& policy, const RetryEnvironment& environment,
                   absl::FunctionRef<absl::Status()> call) {
  const absl::Time last_start = environment.now() + policy.total_timeout;
  retry::Schedule schedule(policy.pauses, environment.jitter);
  for (int tries = 1;; ++tries) {
    absl::Status status = call();
    if (status.ok() || !IsTransient(status) || tries >= policy.max_tries) return status;
    const absl::Duration pause = schedule.Next();
    if (environment.now() + pause > last_start) return status;
    environment.sleep(pause);
  }
}

absl::Status CallWithRetry(const RetryPolicy& policy, Idempotency idempotency,
                           const RetryEnvironment& environment,
                           absl::FunctionRef<absl::Status(grpc::ClientContext&)> call) {
  RetryPolicy allowed = policy;
  if (idempotency == Idempotency::kNotIdempotent) allowed.max_tries = 1;
  return Retry(allowed, environment, [&] {
    grpc::ClientContext context;
    // gRPC has a clock of its own, not environment.now.
    context.set_deadline(MonotonicDeadline(policy.try_timeout));
    return call(context);
  });
}

}  // namespace lumifold::rpc
