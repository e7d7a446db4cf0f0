#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/threads/event.h"
#include "worker/leases/worker_log.h"

namespace grpc {
class Channel;
}
namespace lumifold::filter {
class FilterDevice;
}
namespace lumifold::monitoring {
struct EndpointSockets;
}

namespace lumifold::worker {

/// Frames that a worker finishes at a time for the coordinator, each on one of its threads, and the memory
/// that they may take together. 0: none.
struct FinishPlaces {
  int count = 0;
  uint64_t memory_bytes = 0;
  /// Memory for units of frames that it keeps until it finishes them.
  uint64_t keep_bytes = 0;
  /// Filters for them; null: the threads do.
  std::shared_ptr<filter::FilterDevice> device = nullptr;
};

/// Where assets are kept for other workers of this machine and later ones, see AssetFolder.
struct KeptAssets {
  std::string folder = {};  // empty: in memory alone
  uint64_t max_bytes = uint64_t{20} << 30;
};

struct WorkerOptions {
  /// Host and process, for the coordinator's log.
  std::string name;
  /// Number of units rendered at the same time, at least 1.
  int threads = 1;
  /// What the machine has or may be used for; see v1::Hello.
  std::vector<std::string> tags = {};
  /// Memory that it may use, see v1::Hello; 0: not known.
  uint64_t memory_bytes = 0;
  /// Whether it renders units at all.
  bool renders = true;
  FinishPlaces finishing = {};
  WorkerLog log = SilentLog();
  KeptAssets assets = {};

  /// Once it is notified the worker leaves: it takes no more leases, hands back those that wait, finishes the
  /// units being rendered within `drain`, hands back the others, and ends. So it does when an operator drains
  /// it. Null: never.
  const threads::Event* leave = nullptr;
  absl::Duration drain = absl::Seconds(30);
  /// Why the worker takes no leases for now; empty: it takes them. It stays connected, hands back what waits,
  /// finishes the units being rendered within `drain`, and hands back the others. Asked several times a
  /// second; null: it always takes leases.
  std::function<std::string()> rest_reason = nullptr;
  /// Why the worker can no longer be admitted, as its certificate has expired; asked before each connection.
  /// Null: it has none.
  std::function<absl::Status()> check_identity = nullptr;
  /// A worker that has held no lease for this long leaves, connected or not.
  absl::Duration exit_when_idle = absl::InfiniteDuration();
  /// Called several times a second, while the worker does not hang; null: nobody asks.
  std::function<void()> alive = nullptr;
  /// Where metrics are shown; null: nowhere.
  const monitoring::EndpointSockets* metrics = nullptr;
};

/// The coordinators of a farm, see rpc::ParseEndpoints.
struct Coordinators {
  /// Not empty, in the order in which they are tried.
  std::vector<std::string> addresses;
  /// A new channel to one of them, or to one that a coordinator has sent the worker to. Errors: it must not
  /// be connected to.
  std::function<absl::StatusOr<std::shared_ptr<grpc::Channel>>(const std::string& address)> connect;
};

/// Renders units for one of the coordinators at a time until the worker has left or `stop` is notified;
/// `stop` breaks the connection at once. Blocks. After a broken connection it goes on as Route says, without
/// limit, unless it was leaving.
/// Errors: kFailedPrecondition or kInvalidArgument when each coordinator refuses this worker;
/// kUnauthenticated or kPermissionDenied when they do not admit the worker's identity: the certificate was
/// revoked, is not known, has expired or is not a worker's; kDeadlineExceeded when it leaves because of
/// `exit_when_idle` and no coordinator has admitted it.
absl::Status RunWorker(const Coordinators& coordinators, const WorkerOptions& options,
                       const threads::Event& stop);

}  // namespace lumifold::worker
