#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "proto/rpc/monotonic.h"
#include "worker/asset_source.h"

namespace grpc {
class Channel;
}
namespace spdlog {
class logger;
}

namespace lumifold::worker {

/// Fetches assets from the coordinator and resumes broken transfers.
std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel);

struct WorkerOptions {
  /// Host and process, for the coordinator's log.
  std::string name;
  /// Number of units rendered at the same time, at least 1.
  int threads = 1;
  /// Log of events; null for none.
  std::shared_ptr<spdlog::logger> log;
};

/// Renders units for the coordinator at the other end of `channel` until `stop` is notified. Blocks. After a
/// broken connection it reconnects with the pauses of rpc::ReconnectSchedule, without limit.
/// Errors: kFailedPrecondition or kInvalidArgument when the coordinator refuses this worker.
absl::Status RunWorker(std::shared_ptr<grpc::Channel> channel, WorkerOptions options,
                       const rpc::MonotonicEvent& stop);

}  // namespace lumifold::worker
