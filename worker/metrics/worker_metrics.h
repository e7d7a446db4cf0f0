#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "absl/time/time.h"

namespace prometheus {
class Collectable;
}  // namespace prometheus

namespace lumifold::monitoring {

/// A worker in numbers. Those of a label have all its values, zero or not.
struct WorkerMetrics {
  bool is_connected = false;              // a coordinator has admitted it
  std::map<std::string, int64_t> leases;  // that it holds, by state

  // Since the worker's start.
  int64_t connections = 0;  // on which a coordinator has admitted it
  int64_t units_rendered = 0;
  int64_t frames_finished = 0;
  std::map<std::string, int64_t> failures;  // units, by reason
  int64_t samples = 0;                      // camera samples of rendered units
  int64_t rays = 0;                         // of rendered units, to lights too
  std::map<std::string, double> seconds;    // of render threads, by activity
  int64_t scenes_loaded = 0;
  absl::Duration load_time;               // of threads that load scenes
  std::map<std::string, int64_t> assets;  // by where they came from
  int64_t asset_bytes_received = 0;
  int64_t unit_bytes_sent = 0;

  uint64_t asset_cache_bytes = 0;  // in memory
};

/// A source of metrics that calls `metrics`, from the endpoint's thread, whenever it is asked.
std::shared_ptr<prometheus::Collectable> MakeWorkerMetrics(std::function<WorkerMetrics()> metrics);

}  // namespace lumifold::monitoring
