#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/autoscale/policy/types.h"

namespace lumifold::sim {

/// A farm and an engine in virtual time, second by second, and the autoscaler's policy that steps every 15 s.
struct AutoscaleCase {
  std::string name = {};
  std::string title = {};
  autoscale::Limits limits{.maximum = 20};
  autoscale::Tuning tuning{.slots_per_worker = 4};
  absl::Duration length = absl::Hours(1);
  double unit_seconds = 6;
  /// From the request to the start of its worker, and from there until it has joined.
  int pending_seconds = 20;
  int join_seconds = 5;
  /// Of second t: units that are submitted; whether the engine refuses; whether workers that start die after
  /// two seconds; how many workers are taken away.
  std::function<int(int t)> submitted = {};
  std::function<bool(int t)> refuses = [](int) { return false; };
  std::function<bool(int t)> deadly = [](int) { return false; };
  std::function<int(int t)> taken = [](int) { return 0; };
  /// Taken workers come back as pending (Slurm's requeue) or are gone.
  bool requeues = false;
};

struct AutoscaleSample {
  int second = 0;
  int wanted = 0;
  int pending = 0;
  int running = 0;
  int queued = 0;
  int started = 0;  // requests so far, refused ones included
  std::string reason;
};

struct AutoscaleResult {
  std::vector<AutoscaleSample> samples;  // one a step
  int starts = 0;                        // requests that the engine took
  int refused = 0;                       // requests that it refused
  int deaths = 0;                        // at start
  int most_active = 0;                   // pending and running at a time
  int most_needless = 0;                 // requests at a time over those that the work or the limits allow
  int busy_released = 0;                 // workers that were released with units
  int units_done = 0;
  int last_done = 0;      // second of the last unit
  int gone_after = 0;     // second at which the last worker left; 0: some are there
  double core_hours = 0;  // of all workers, as the engine counts
};

AutoscaleResult Simulate(const AutoscaleCase& scenario);

/// The cases of docs/results/autoscale.md.
std::vector<AutoscaleCase> AutoscaleCases();
AutoscaleCase AutoscaleCaseNamed(const std::string& name);

}  // namespace lumifold::sim
