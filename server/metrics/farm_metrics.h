#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"

namespace prometheus {
class Collectable;
}  // namespace prometheus

namespace lumifold::monitoring {

/// Bytes.
struct TrafficMetrics {
  int64_t units_received = 0;
  int64_t assets_received = 0;  // uploads
  int64_t results_sent = 0;
  int64_t assets_sent = 0;       // to workers
  int64_t units_sent = 0;        // to workers that finish frames
  int64_t results_received = 0;  // from them
};

/// Frames that are rendered, and rounds of frames.
struct FrameMetrics {
  int64_t filtering = 0;   // here
  int64_t on_workers = 0;  // that finish them
  int64_t waiting = 0;     // for a place, or for a new try
};

struct StorageMetrics {
  bool writable = true;
  uint64_t free_bytes = 0;
  uint64_t room_bytes = 0;  // of them, those that uploads and films may take
};

/// The state of a coordinator's farm in numbers.
struct FarmMetrics {
  int64_t units_queued = 0;  // of jobs that are not paused; no worker has them, and none has delivered them
  int64_t units_leased = 0;  // rendered now, once or twice
  int64_t units_committed = 0;  // since the coordinator's start
  int64_t worker_slots = 0;     // units that the connected workers take at a time
  int64_t page_viewers = 0;     // browsers that watch the status page
  std::map<v1::WorkerState, int64_t> workers;
  std::map<v1::JobState, int64_t> jobs;  // active ones
  FrameMetrics frames;
  int64_t blocked_names = 0;  // workers that operators or audits have blocked, connected or not

  // Since the coordinator's start.
  int64_t samples_committed = 0;           // camera samples
  int64_t leases_expired = 0;              // not renewed, or without progress
  std::map<std::string, int64_t> retries;  // units that became free again, by reason: all, zero or not
  TrafficMetrics traffic;
  v1::WebhookCounts webhooks;

  StorageMetrics storage;
};

/// A source of metrics that calls `metrics`, from the endpoint's thread, whenever it is asked. Each state has
/// a sample, zero or not, so that a sum over them never has a gap.
std::shared_ptr<prometheus::Collectable> MakeFarmMetrics(std::function<FarmMetrics()> metrics);

}  // namespace lumifold::monitoring
