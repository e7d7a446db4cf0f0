#pragma once

#include <cstdint>
#include <string>

#include "absl/time/time.h"

namespace lumifold::sim {

/// What is wrong with a machine.
enum class Misdeed {
  kFailsAll,       // calls every unit impossible as soon as it has it
  kFailsSlowly,    // renders every unit and then fails it, not for good
  kFailsOneScene,  // calls the units of the first job impossible
  kDies,           // with every unit that it gets; its next process connects a few seconds later
  kHangs,          // sends heartbeats, but its units make no progress
  kLies,           // delivers wrong pixels in half of its units
};

/// What is wrong with a job that no machine can render.
enum class BadJob {
  kFails,    // its units are reported as impossible
  kCrashes,  // its units end their workers
};

/// A farm to simulate. Times are virtual. Equal settings give equal results on every machine.
struct FarmSettings {
  uint32_t seed = 1;
  int workers = 10'000;
  int slots = 2;
  int users = 20;
  int jobs = 200;
  int64_t units = 1'000'000;  // of all jobs together, about
  int frames_per_job = 5;
  /// Workers' speeds are log-uniform in [slowest, 1 / slowest] times one reference machine.
  double slowest = 0.5;
  /// Mean time of a unit on the reference machine; jobs differ by a factor of up to `job_spread` either way,
  /// and the units of a job by one of up to `unit_spread`.
  absl::Duration mean_unit = absl::Seconds(20);
  double job_spread = 2;
  double unit_spread = 2;
  /// Share of the leases that take ten times as long, because of something else on the machine.
  double straggler_share = 0.001;
  /// Share of the leases whose unit hangs: the worker sends heartbeats, but makes no progress.
  double hang_share = 0.00001;
  /// Mean time after which a worker dies; a new one replaces it after `reboot`.
  absl::Duration mean_life = absl::Hours(5);
  absl::Duration reboot = absl::Minutes(2);
  /// One way over the network, at most; a delay is uniform in [0, this].
  absl::Duration network = absl::Milliseconds(100);
  /// From the delivery of a unit to the end of its commit, at most.
  absl::Duration commit = absl::Milliseconds(200);
  absl::Duration heartbeat = absl::Seconds(5);
  /// Loading a scene, once for each job on a worker, which keeps the last `scenes_kept`.
  absl::Duration scene_load = absl::Seconds(2);
  int scenes_kept = 4;
  /// From the last commit of a frame to its result.
  absl::Duration filter = absl::Seconds(3);
  int max_active_frames = 1000;
  /// Users submit their jobs within this time, the jobs of a user one after the other.
  absl::Duration arrivals = absl::ZeroDuration();
  /// Every fifth job has this priority, all others 0.
  int high_priority = 0;
  double audit_share = 0;
  /// So many of the workers do this.
  int bad_machines = 0;
  Misdeed misdeed = Misdeed::kLies;
  /// They are alone for this long; then the good ones connect.
  absl::Duration alone = absl::ZeroDuration();
  /// So many of the jobs, the first ones, are like this.
  int bad_jobs = 0;
  BadJob badness = BadJob::kFails;
  /// Units are this many times larger and fewer: what a choice of larger tiles would do.
  double unit_scale = 1;
  /// Window over which shares are compared.
  absl::Duration window = absl::Seconds(60);
};

struct FarmResult {
  bool finished = false;
  int64_t units = 0;
  int64_t leases = 0;
  int64_t heartbeats = 0;
  int64_t scene_loads = 0;
  int64_t deaths = 0;
  int64_t second_leases = 0;  // of units that had one already
  absl::Duration makespan;
  /// Total work / total speed, with dead workers counted as if they lived.
  absl::Duration ideal;
  /// The longest unit on the slowest machine: what the last unit may add to the ideal if nobody knows how
  /// long a unit takes.
  absl::Duration longest_unit;
  /// When the last unit was leased for the first time.
  absl::Duration last_leased;
  /// Largest relative deviation of a user's slot time from its share, over windows in which it had free units
  /// from beginning to end. A share is weighted, as scheduler.h says.
  double unfairness = 0;
  absl::Duration unfair_at;  // end of that window
  /// Longest time for which no job of a user and priority got a lease although one had free units.
  absl::Duration longest_wait;
  absl::Duration waited_at;
  /// Calls of the scheduler and the time they took on this machine.
  int64_t calls = 0;
  double scheduler_seconds = 0;
  int64_t scheduler_bytes = 0;  // allocated at its peak, as malloc counts
  /// Jobs that failed though a good machine can render them, and others.
  int innocent_failed = 0;
  int bad_failed = 0;
  /// Leases of bad machines, other than those that they delivered with the right pixels; the same of bad
  /// jobs, and the workers that these ended.
  int64_t spoiled_by_machines = 0;
  int64_t spoiled_by_jobs = 0;
  int64_t workers_ended = 0;
  /// What Explain says of the first job after a minute: the codes of its reasons.
  std::string reasons;
  int faulty_found = 0;
  int64_t units_redone = 0;  // revoked, of faulty workers
  int64_t wrong_units = 0;   // wrong pixels in finished frames
};

FarmResult Simulate(const FarmSettings& settings);

}  // namespace lumifold::sim
