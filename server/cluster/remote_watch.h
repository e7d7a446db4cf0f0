#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "lumifold/v1/farm.pb.h"
#include "server/cluster/farm_peers.h"

namespace lumifold::cluster {

/// Watches a job at the coordinator that owns it.
/// Threads: safe.
class RemoteWatch {
 public:
  struct Listener {
    std::function<void(const v1::JobStatus&)> on_status;
    /// The stream has ended; OK after the last status of a job.
    std::function<void(const absl::Status&)> on_end;
  };
  /// The listener is called from other threads, one at a time, until Stop.
  static std::shared_ptr<RemoteWatch> Start(const FarmPeers::Peer& peer, const FarmPeers& peers,
                                            const access::Identity& caller, const std::string& trace_parent,
                                            const v1::WatchJobRequest& request, Listener listener);
  virtual ~RemoteWatch() = default;
  /// After it returns the listener is not called again. Must not be called by the listener.
  virtual void Stop() = 0;
};

}  // namespace lumifold::cluster
