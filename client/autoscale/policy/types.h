#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "proto/retry/pauses.h"

/// What the autoscaler's policy sees and decides. A *request* is one worker asked of the engine: a Slurm job.
/// Times are wall clock times, because the engine's records have those.
namespace lumifold::autoscale {

/// Units of one user.
struct UserQueue {
  int64_t queued = 0;
  int64_t leased = 0;
};

struct FarmWorker {
  std::string id = {};       // "w-7"
  std::string process = {};  // what the worker calls itself; names its request
  enum class State { kIdle, kBusy, kUseless } state = State::kIdle;  // kUseless: blocked
  int slots = 1;
  int64_t units_done = 0;
  double seconds_per_unit = 0;
};

struct FarmState {
  std::vector<UserQueue> users = {};
  std::vector<FarmWorker> workers = {};
};

struct Request {
  /// Of the engine; the same request has the same id at every look.
  std::string id = {};
  /// What its worker calls itself, up to the end or a ":" or "@".
  std::string worker_name = {};
  enum class State { kPending, kRunning, kLeaving, kEnded } state = State::kPending;
  /// How it ended. kTaken: by the engine (preemption, a lost node); kReleased: on demand, or at its time
  /// limit.
  enum class End { kNone, kLeft, kFailed, kTaken, kReleased } end = End::kNone;
  /// A second request for the place of another one; the engine does not run both.
  bool duplicate = false;
  /// Position in the engine's order.
  int slot = -1;
  absl::Time started = absl::InfiniteFuture();
  absl::Time ended = absl::InfiniteFuture();
  double cores = 1;
  std::string detail = {};  // the engine's words about its state; may be empty
};

struct EngineState {
  std::vector<Request> requests = {};
};

struct Limits {
  int minimum = 0;
  int maximum = 8;
  /// Workers for the jobs of one user; 0: no limit.
  int per_user = 0;
  /// Core-hours of a period; 0: no limit.
  double budget_core_hours = 0;
  /// Begins at multiples of itself since 1970 in UTC. Infinite: it never ends.
  absl::Duration budget_period = absl::InfiniteDuration();
};

struct Tuning {
  /// Workers are asked for so that the work that is left takes this long. Half of it doubles the workers of
  /// medium jobs, and the share of their time that goes into starting; twice of it halves both.
  absl::Duration finish_within = absl::Minutes(10);
  /// An idle worker is released after this time. Less than the --exit-when-idle of workers, which holds if
  /// the autoscaler is away. Half of it starts workers anew in shorter gaps between jobs; twice of it pays
  /// for longer ones.
  absl::Duration idle = absl::Minutes(2);
  /// Pauses after a refusal or a death at start: the first, doubled with each, up to the longest.
  retry::Pauses pauses = {.first = absl::Seconds(10), .longest = absl::Minutes(10)};
  /// Who ends by itself within this time has died at its start.
  absl::Duration start_time = absl::Seconds(30);
  /// A request that runs and has no connected worker for so long is released, as one that died at its start.
  absl::Duration join_within = absl::Minutes(10);
  /// Requests of one step: bounds its time, and what a mistake costs.
  int starts_at_a_time = 32;
  /// Until a worker has told its own.
  int slots_per_worker = 1;
  double cores_per_worker = 1;
};

}  // namespace lumifold::autoscale
