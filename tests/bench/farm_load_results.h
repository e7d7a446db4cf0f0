#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/synchronization/notification.h"
#include "lumifold/v1/worker.grpc.pb.h"

namespace lumifold::bench {

/// Finishes frames in the name of workers: fetches the units, once it may, which nobody reads, and delivers a
/// file that is ready. Of frames that a worker keeps nothing is fetched, and nothing waited for.
/// Threads: safe.
class ReadyResults {
 public:
  /// Of files of this many bytes.
  explicit ReadyResults(size_t bytes);

  /// From now on frames are finished.
  void Begin() { begun_.Notify(); }
  /// Waits until it may, then finishes one frame.
  /// Errors: those of the calls.
  absl::Status Finish(v1::WorkerService::StubInterface* coordinator, const std::string& worker_id,
                      const v1::Lease& lease) const;

 private:
  absl::Status Deliver(v1::WorkerService::StubInterface* coordinator, const std::string& worker_id,
                       const v1::Lease& lease) const;

  std::string file_;
  std::string sha256_;
  absl::Notification begun_;
};

}  // namespace lumifold::bench
