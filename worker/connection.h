#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "proto/rpc/monotonic.h"

namespace grpc {
class Channel;
}
namespace spdlog {
class logger;
}

namespace lumifold::worker {

struct WorkerOptions {
  /// Host and process, for the coordinator's log.
  std::string name;
  /// Number of units rendered at the same time, at least 1.
  int threads = 1;
  /// What the machine has or may be used for; see v1::Hello.
  std::vector<std::string> tags = {};
  /// Log of events; null for none.
  std::shared_ptr<spdlog::logger> log = nullptr;

  /// Once it is notified the worker leaves: it takes no more leases, hands back those that wait, finishes the units
  /// being rendered within `drain`, hands back the others, and ends. So it does when an operator drains it. Null:
  /// never.
  const rpc::MonotonicEvent* leave = nullptr;
  absl::Duration drain = absl::Seconds(30);
  /// Why the worker can no longer be admitted, as its certificate has expired; asked before each connection. Null: it
  /// has none.
  std::function<absl::Status()> check_identity = nullptr;
  /// A worker that has held no lease for this long leaves, connected or not.
  absl::Duration exit_when_idle = absl::InfiniteDuration();
};

/// Renders units for the coordinator at the other end of `channel` until the worker has left or `stop` is notified;
/// `stop` breaks the connection at once. Blocks. After a broken connection it reconnects with the pauses of
/// rpc::ReconnectSchedule, without limit, unless it was leaving.
/// Errors: kFailedPrecondition or kInvalidArgument when the coordinator refuses this worker; kUnauthenticated or
/// kPermissionDenied when it does not admit the worker's identity: the certificate was revoked, is not known, has expired
/// or is not a worker's; kDeadlineExceeded when it leaves because of `exit_when_idle` and no coordinator has admitted it.
absl::Status RunWorker(const std::shared_ptr<grpc::Channel>& channel, const WorkerOptions& options,
                       const rpc::MonotonicEvent& stop);

}  // namespace lumifold::worker
