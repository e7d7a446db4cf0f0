#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>

#include "server/job/ids.h"

namespace lumifold::scheduler {

struct Worker {
  std::string name;
  std::string numeric_class;
  int slots = 1;
  int busy = 0;               // leases and accepted units
  bool unresponsive = false;  // a lease expired and no heartbeat came since
  bool reserved = false;      // for a unit in quarantine
};

/// The connected workers, and which of them can take a unit. Every call takes O(log n).
///
/// A worker is available unless it is unresponsive; it is free if it is available, not reserved, and has
/// a free slot.
/// Threads: one at a time.
class WorkerPool {
 public:
  /// `id` is new, slots >= 1.
  void Add(job::WorkerId id, const std::string& name, const std::string& numeric_class, int slots);
  /// No effect on an unknown worker, as for the calls below.
  void Remove(job::WorkerId id);
  void SetUnresponsive(job::WorkerId id, bool unresponsive);
  void SetReserved(job::WorkerId id, bool reserved);
  void TakeSlot(job::WorkerId id) { AddBusy(id, 1); }
  void ReleaseSlot(job::WorkerId id) { AddBusy(id, -1); }

  /// Null for an unknown worker; valid until Remove.
  const Worker* Find(job::WorkerId id) const;
  bool IsFree(job::WorkerId id) const;
  /// Whether a worker of the class, "" for any, is available besides `id`.
  bool HasOther(job::WorkerId id, const std::string& numeric_class) const;

  /// The class after `numeric_class` that has free workers, in alphabetical order; classes are not empty.
  std::optional<std::string> NextFreeClass(const std::string& numeric_class) const;
  /// The first free worker of the class after `id`, in the order of ids.
  std::optional<job::WorkerId> NextFree(const std::string& numeric_class, job::WorkerId id) const;

 private:
  static bool IsAvailable(const Worker& worker) { return !worker.unresponsive; }
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
  std::map<std::string, std::set<job::WorkerId>> free_;  // by class; never empty
};

}  // namespace lumifold::scheduler
