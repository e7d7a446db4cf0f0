#pragma once

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/synchronization/notification.h"
#include "worker/asset_source.h"

namespace grpc {
class Channel;
}
namespace spdlog {
class logger;
}

namespace lumifold::worker {

/// Fetches assets from the coordinator; a broken transfer goes on where it stopped.
std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel);

struct WorkerOptions {
  /// For the coordinator's log: host and process.
  std::string name;
  /// Units rendered at the same time, at least 1.
  int threads = 1;
  /// Where events are told; null for nowhere.
  std::shared_ptr<spdlog::logger> log;
};

/// Works for the coordinator at the other end of `channel` until `stop` is notified. Blocks. A connection
/// that breaks is made anew after a moment, for ever. Errors: kFailedPrecondition or kInvalidArgument when
/// the coordinator refuses this worker.
absl::Status RunWorker(std::shared_ptr<grpc::Channel> channel, WorkerOptions options,
                       const absl::Notification& stop);

}  // namespace lumifold::worker
