#pragma once

#include <compare>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/lease_ahead.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// What a worker is, or what a job requires of its workers; then an empty class means any.
struct Requirement {
  std::string numeric_class;
  std::vector<std::string> tags;  // ascending, each once
  uint64_t memory_bytes = 0;

  static Requirement Of(const std::string& numeric_class, std::vector<std::string> tags);
  /// Whether a worker of `kind` may render a job that requires this.
  bool Admits(const Requirement& kind) const;
  friend auto operator<=>(const Requirement&, const Requirement&) = default;  // NOLINT(modernize-use-nullptr)
};

/// Units of a worker.
struct UnitTally {
  int64_t done = 0;
  int64_t failed = 0;
  absl::Duration time;  // sum over those that are done
};

struct Worker {
  WorkerTraits traits;
  int kind = 0;               // number of its class, tags and memory, see WorkerPool
  int busy = 0;               // leases, and accepted units that fill a slot
  bool unresponsive = false;  // a lease expired and no heartbeat came since
  bool reserved = false;      // for a unit in quarantine
  bool draining = false;
  std::string rest;  // why it takes no leases for now; empty: it takes them
  bool blocked = false;
  absl::Time cools_until = absl::InfinitePast();  // InfinitePast unless it cools down, see WorkerHealth
  int64_t last_job = -1;                          // of its last lease; -1: none
  /// Mean of its times for a unit / those of the unit's job, see SecondLeases::Rate.
  double slowness = 1;
  int rated = 0;
  UnitTally units;
  LeaseAhead ahead;

  bool IsCooling() const { return cools_until != absl::InfinitePast(); }
  bool IsAvailable() const {
    return traits.slots > 0 && !unresponsive && !draining && rest.empty() && !blocked && !IsCooling();
  }
  bool IsFree() const {
    return IsAvailable() && !reserved && busy < traits.slots + ahead.Leases(traits.slots);
  }
};

/// How a list shows the worker.
v1::WorkerState StateOf(const Worker& worker);

/// Numbers of workers of one kind; those without slots do not count.
struct KindCounts {
  int connected = 0;
  int available = 0;
  int cooling = 0;
  int64_t slots = 0;  // of available workers
  int64_t busy = 0;   // of these
};

/// The connected workers, and which of them can take a unit. Workers of equal class and tags, and of about
/// the same memory (rounded down by less than 1/32, so that there are few kinds), are of one kind; kinds have
/// numbers from 0 on. A call takes O(log n) unless it says otherwise.
///
/// A worker is available unless it has no slots or is unresponsive, draining, resting, blocked or cooling
/// down; it is free if it is available, not reserved, and has a free slot.
///
/// Threads: one at a time.
class WorkerPool {
 public:
  /// `id` is new.
  void Add(job::WorkerId id, const WorkerTraits& traits);
  /// No effect on an unknown worker.
  void Remove(job::WorkerId id);
  /// Applies `change` to the state of a worker; no effect on an unknown one. Its kind, and the traits that
  /// make it, stay.
  void Change(job::WorkerId id, absl::FunctionRef<void(Worker&)> change);
  void TakeSlot(job::WorkerId id) {
    Change(id, [](Worker& worker) { ++worker.busy; });
  }
  void ReleaseSlot(job::WorkerId id) {
    Change(id, [](Worker& worker) { --worker.busy; });
  }

  /// Null for an unknown worker; valid until Remove.
  const Worker* Find(job::WorkerId id) const;
  bool IsFree(job::WorkerId id) const;
  /// The connections of the workers with this name.
  std::vector<job::WorkerId> Named(const std::string& name) const;
  /// At most `limit` workers with ids above `after`, ascending.
  std::vector<job::WorkerId> After(job::WorkerId after, int limit) const;

  /// Changes whenever the first worker of a kind becomes available, or the last one ceases to be.
  int64_t version() const { return version_; }
  const Requirement& KindOf(int kind) const { return kinds_.at(kind).kind; }
  /// Sum over the kinds that `requirement` admits; O(kinds).
  KindCounts Count(const Requirement& requirement) const;
  /// The most memory of the connected workers that it admits; 0: there is none, or that is not known.
  /// O(kinds).
  uint64_t LargestMemory(const Requirement& requirement) const;
  /// Workers that were available and are no longer, or have gone, since the last call.
  std::set<job::WorkerId> TakeCeased() { return std::exchange(ceased_, {}); }
  /// Whether a worker that `requirement` admits is available besides `id`; O(kinds).
  bool HasOther(job::WorkerId id, const Requirement& requirement) const;

  /// Workers whose cool-down is over at `now`, in the order of its ends.
  std::vector<job::WorkerId> Cooled(absl::Time now) const;
  /// When the first one is over; InfiniteFuture if no worker cools down.
  absl::Time NextCooled() const;

  /// The first kind after number `kind` that has free workers.
  std::optional<int> NextFreeKind(int kind) const;
  /// The first free worker of the kind after `id`, in the order of ids.
  std::optional<job::WorkerId> NextFree(int kind, job::WorkerId id) const;

 private:
  struct Kind {
    Requirement kind;
    KindCounts counts;
    int workers = 0;  // those without slots, too
  };

  int AddKind(const WorkerTraits& traits);
  /// Removes the worker from the indices below, or enters it, by its present state.
  void Unindex(job::WorkerId id, const Worker& worker);
  void Index(job::WorkerId id, const Worker& worker);

  std::map<job::WorkerId, Worker> workers_;
  std::map<std::string, std::set<job::WorkerId>> by_name_;
  int next_kind_ = 0;
  int64_t version_ = 0;
  std::map<Requirement, int> kind_numbers_;
  std::map<int, Kind> kinds_;                                  // with connected workers
  std::set<std::pair<absl::Time, job::WorkerId>> cool_downs_;  // by their ends
  std::map<int, std::set<job::WorkerId>> free_;                // by kind; never empty
  std::set<job::WorkerId> ceased_;
};

}  // namespace lumifold::scheduler
