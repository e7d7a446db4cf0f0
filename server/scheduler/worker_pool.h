#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"

namespace lumifold::scheduler {

struct Worker {
  std::string name;
  std::string numeric_class;
  int slots = 1;
  int busy = 0;               // leases and accepted units
  bool unresponsive = false;  // a lease expired and no heartbeat came since
  bool reserved = false;      // for a unit in quarantine
  /// Jobs of which other workers rendered a unit that this one had failed, and when that was last.
  std::map<int64_t, absl::Time> blamed_jobs;
  absl::Time set_aside_until = absl::InfinitePast();  // InfinitePast if it is not set aside
};

/// The connected workers, and which of them can take a unit. Every call takes O(log n).
///
/// A worker is available unless it is unresponsive or set aside; it is free if it is available, not reserved,
/// and has a free slot.
/// Threads: one at a time.
class WorkerPool {
 public:
  /// `id` is new, slots >= 1.
  void Add(job::WorkerId id, const std::string& name, const std::string& numeric_class, int slots);
  /// No effect on an unknown worker, as for the calls below.
  void Remove(job::WorkerId id);
  void SetUnresponsive(job::WorkerId id, bool unresponsive);
  void SetReserved(job::WorkerId id, bool reserved);
  /// Sets the worker aside until a time, or readmits it with InfinitePast.
  void SetAside(job::WorkerId id, absl::Time until);
  /// The worker is known.
  std::map<int64_t, absl::Time>& BlamedJobs(job::WorkerId id) { return workers_.at(id).blamed_jobs; }
  void TakeSlot(job::WorkerId id) { AddBusy(id, 1); }
  void ReleaseSlot(job::WorkerId id) { AddBusy(id, -1); }

  /// Null for an unknown worker; valid until Remove.
  const Worker* Find(job::WorkerId id) const;
  bool IsFree(job::WorkerId id) const;
  /// Whether a worker of the class, "" for any, is available besides `id`.
  bool HasOther(job::WorkerId id, const std::string& numeric_class) const;

  /// Workers of the class that are set aside, or available.
  int SetAsideCount(const std::string& numeric_class) const;
  int AvailableCount(const std::string& numeric_class) const;
  /// Workers whose time aside is over at `now`, in the order of these times.
  std::vector<job::WorkerId> Readmissible(absl::Time now) const;
  /// When the first of them is; InfiniteFuture if none is set aside.
  absl::Time NextReadmission() const;

  /// The class after `numeric_class` that has free workers, in alphabetical order; classes are not empty.
  std::optional<std::string> NextFreeClass(const std::string& numeric_class) const;
  /// The first free worker of the class after `id`, in the order of ids.
  std::optional<job::WorkerId> NextFree(const std::string& numeric_class, job::WorkerId id) const;

 private:
  static bool IsAvailable(const Worker& worker) {
    return !worker.unresponsive && worker.set_aside_until == absl::InfinitePast();
  }
  static bool IsFree(const Worker& worker) {
    return IsAvailable(worker) && !worker.reserved && worker.busy < worker.slots;
  }
  void AddBusy(job::WorkerId id, int change);
  /// Removes the worker from the indices below, or enters it, by its present state.
  void Unindex(job::WorkerId id, const Worker& worker);
  void Index(job::WorkerId id, const Worker& worker);

  std::map<job::WorkerId, Worker> workers_;
  std::map<std::string, int> available_;  // number, by class; never 0
  int all_available_ = 0;
  std::map<std::string, int> set_aside_;  // number, by class; never 0
  std::set<std::pair<absl::Time, job::WorkerId>> readmissions_;
  std::map<std::string, std::set<job::WorkerId>> free_;  // by class; never empty
};

}  // namespace lumifold::scheduler
