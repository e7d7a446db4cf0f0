#include "server/scheduler/workers.h"

#include <set>
#include <utility>

namespace lumifold::scheduler {

using job::Attempt;
using job::WorkerId;

Workers::Workers(State* state, Leasing* leasing, LeaseWatch* watch)
    : state_(state), leasing_(leasing), watch_(watch) {}

void Workers::Add(WorkerId worker, const WorkerTraits& traits) {
  WorkerTraits named = traits;
  if (named.name.empty()) named.name = job::TextOf(worker);
  if (named.party.empty()) named.party = named.name;
  EndEarlierConnection(worker, named);
  state_->workers.Add(worker, named);
  state_->evidence.AddProcess(named.party, named.instance);
  watch_->TakeBackLosses(worker);
  if (!state_->health.IsBlocked(named.name)) return;
  state_->workers.Change(worker, [](Worker& changed) { changed.blocked = true; });
}

void Workers::EndEarlierConnection(WorkerId worker, const WorkerTraits& traits) {
  if (traits.instance == 0) return;
  const auto [connection, is_first] = connections_.try_emplace(traits.instance, worker);
  if (is_first) return;
  const WorkerId earlier = std::exchange(connection->second, worker);
  // Otherwise it is not the same process, whatever it says.
  if (state_->workers.Find(earlier)->traits.name != traits.name) return;
  Drain(earlier);
  for (const Attempt attempt : state_->leases.OfWorker(earlier))
    leasing_->Release(attempt, RetryReason::kWorkerLost);
}

void Workers::Remove(WorkerId worker) {
  if (const Worker* state = state_->workers.Find(worker); state != nullptr) {
    const auto connection = connections_.find(state->traits.instance);
    if (connection != connections_.end() && connection->second == worker) connections_.erase(connection);
  }
  state_->quarantine.Cancel(worker);
  for (const Attempt attempt : state_->leases.OfWorker(worker)) {
    const Lease lease = *state_->leases.Find(attempt);
    watch_->CountLoss(lease);
    watch_->NoteAbsence(lease);
    leasing_->Release(attempt, RetryReason::kWorkerLost);
  }
  watch_->Remove(worker);
  state_->quarantine.Remove(worker);
  state_->health.Remove(worker);
  state_->workers.Remove(worker);
}

void Workers::Drain(WorkerId worker) {
  state_->quarantine.Cancel(worker);
  state_->workers.Change(worker, [](Worker& changed) { changed.draining = true; });
}

void Workers::Rest(WorkerId worker, const std::string& reason) {
  if (!reason.empty()) state_->quarantine.Cancel(worker);
  state_->workers.Change(worker, [&reason](Worker& changed) { changed.rest = reason; });
}

void Workers::Block(const std::string& name, const std::string& reason) {
  state_->health.Block(name, reason);
  for (const WorkerId worker : state_->workers.Named(name)) {
    state_->quarantine.Cancel(worker);
    for (const Attempt attempt : state_->leases.OfWorker(worker))
      leasing_->Revoke(attempt, RetryReason::kWorkerBlocked);
  }
}

std::vector<BlockedWorker> Workers::Blocked() const {
  std::vector<BlockedWorker> blocked;
  for (const auto& [name, reason] : state_->health.blocked()) blocked.push_back({name, reason});
  return blocked;
}

WorkerInfo Workers::InfoOf(WorkerId id, const Worker& worker) const {
  WorkerInfo info{.worker = id, .traits = worker.traits, .state = StateOf(worker)};
  const auto blocked = state_->health.blocked().find(worker.traits.name);
  info.reason = blocked == state_->health.blocked().end() ? CoolDownReason(id) : blocked->second;
  if (info.reason.empty()) info.reason = worker.rest;
  std::set<job::JobId> jobs;
  for (const Attempt attempt : state_->leases.OfWorker(id)) {
    ++info.leases;
    jobs.insert(state_->jobs.Get(state_->leases.Find(attempt)->unit.job).id);
  }
  info.jobs.assign(jobs.begin(), jobs.end());
  info.units_done = worker.units.done;
  info.units_failed = worker.units.failed;
  if (worker.units.done > 0) info.mean_time = worker.units.time / worker.units.done;
  return info;
}

std::optional<WorkerInfo> Workers::Describe(WorkerId id) const {
  const Worker* worker = state_->workers.Find(id);
  return worker == nullptr ? std::nullopt : std::optional(InfoOf(id, *worker));
}

std::vector<WorkerInfo> Workers::List(WorkerId after, int limit) const {
  std::vector<WorkerInfo> infos;
  for (const WorkerId id : state_->workers.After(after, limit))
    infos.push_back(InfoOf(id, *state_->workers.Find(id)));
  return infos;
}

}  // namespace lumifold::scheduler
