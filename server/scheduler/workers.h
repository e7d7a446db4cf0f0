#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "absl/types/span.h"
#include "server/job/ids.h"
#include "server/scheduler/lease_watch.h"
#include "server/scheduler/leasing.h"
#include "server/scheduler/state.h"
#include "server/scheduler/types.h"

namespace lumifold::scheduler {

/// Workers: which are connected, and what operators decide about them.
///
/// Threads: one at a time.
class Workers {
 public:
  /// All must outlive it.
  Workers(State* state, Leasing* leasing, LeaseWatch* watch);

  /// Adds a worker with a new id. Leases of an earlier connection of the same process are released, which
  /// counts as no loss: its end has not been noticed yet, and it gets no more.
  void Add(job::WorkerId worker, const WorkerTraits& traits);
  /// Removes a worker; its leases end at once, and each counts as a loss of the worker with the unit.
  void Remove(job::WorkerId worker);
  /// See LeaseWatch::Heartbeat.
  std::vector<LateLease> Heartbeat(job::WorkerId worker, absl::Span<const HeldLease> held,
                                   job::Attempt newest, absl::Time now) {
    return watch_->Heartbeat(worker, held, newest, now);
  }

  /// The party delivered units before a restart, see Evidence.
  void AddWitness(const std::string& party) { state_->evidence.AddWitness(party); }

  /// Grants the worker no more leases; it finishes those it has.
  void Drain(job::WorkerId worker);
  /// The worker takes no leases for now, or takes them again: then `reason` is empty.
  void Rest(job::WorkerId worker, const std::string& reason);
  /// Revokes the leases of the workers with this name and grants them none until Readmit, those that connect
  /// later included.
  void Block(const std::string& name, const std::string& reason);
  /// Ends a block, drain or cool-down. False if no worker has this name.
  bool Readmit(const std::string& name) { return state_->health.Readmit(name); }
  /// By name.
  std::vector<BlockedWorker> Blocked() const;

  /// Workers that began to cool down since the last call.
  std::vector<CoolingWorker> TakeCooling() { return state_->health.TakeCooling(); }
  /// Why the worker cools down; empty if it does not.
  std::string CoolDownReason(job::WorkerId worker) const { return state_->health.CoolDownReason(worker); }
  /// Workers found faulty since the last call.
  std::vector<FaultyWorker> TakeFaulty() { return state_->health.TakeFaulty(); }

  /// nullopt for a worker that is not connected.
  std::optional<WorkerInfo> Describe(job::WorkerId worker) const;
  /// At most `limit` connected workers with ids above `after`, ascending.
  std::vector<WorkerInfo> List(job::WorkerId after, int limit) const;
  /// Connected workers with this name.
  std::vector<job::WorkerId> Named(const std::string& name) const { return state_->workers.Named(name); }

 private:
  /// Releases the leases of an earlier connection of the worker's process.
  void EndEarlierConnection(job::WorkerId worker, const WorkerTraits& traits);
  WorkerInfo InfoOf(job::WorkerId id, const Worker& worker) const;

  State* const state_;
  Leasing* const leasing_;
  LeaseWatch* const watch_;
  std::map<uint64_t, job::WorkerId> connections_;  // the last one of each process, by WorkerTraits::instance
};

}  // namespace lumifold::scheduler
