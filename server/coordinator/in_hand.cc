// Units that workers have in hand from connections that broke, and workers that other coordinators need.
#include <spdlog/logger.h>

#include <algorithm>
#include <utility>

#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"

namespace lumifold::server {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

namespace {

/// Time for which units in hand of jobs that are not active here are remembered: a job of a coordinator that was lost is
/// claimed meanwhile. Workers drop such units no later than that.
constexpr absl::Duration kRememberInHand = absl::Seconds(60);

/// Connected workers that are looked at for one call of MoveWorkers.
constexpr int kMaxMovable = 1 << 16;

}  // namespace

void Coordinator::NoteInHand(WorkerId worker, const v1::Hello& hello) {
  const absl::Time until = options_.now() + kRememberInHand;
  for (const v1::Lease& lease : hello.in_hand()) {
    UnitRef unit = job::UnitFromProto(lease.unit());
    in_hand_[unit.job].push_back(
        {.worker = worker, .unit = unit, .attempt = Attempt(lease.attempt()), .until = until});
  }
  if (hello.in_hand_size() > 0)
    options_.log->info("event=units_in_hand worker={} units={}", NameOf(worker), hello.in_hand_size());
}

void Coordinator::ForgetInHand(absl::FunctionRef<bool(const UnitInHand&)> condition) {
  for (auto& [job, units] : in_hand_) std::erase_if(units, condition);
  std::erase_if(in_hand_, [](const auto& entry) { return entry.second.empty(); });
}

void Coordinator::GrantInHand() {
  if (!leasing_ || in_hand_.empty()) return;
  const absl::Time now = options_.now();
  ForgetInHand([&](const UnitInHand& unit) { return unit.until <= now; });
  std::map<WorkerId, std::vector<UnitInHand>> by_worker;
  for (auto it = in_hand_.begin(); it != in_hand_.end();) {
    if (!scheduler_.HasJob(it->first)) {
      ++it;
      continue;
    }
    for (UnitInHand& unit : it->second) by_worker[unit.worker].push_back(std::move(unit));
    it = in_hand_.erase(it);
  }
  for (const auto& [worker, units] : by_worker) RegrantTo(worker, units);
}

void Coordinator::RegrantTo(WorkerId worker, const std::vector<UnitInHand>& units) {
  std::vector<UnitRef> wanted;
  wanted.reserve(units.size());
  for (const UnitInHand& unit : units) wanted.push_back(unit.unit);
  const std::vector<scheduler::GrantedLease> granted = scheduler_.Regrant(worker, wanted, options_.now());
  options_.log->info("event=leases_regranted worker={} leases={}/{}", NameOf(worker), granted.size(),
                     units.size());
  SendGrants(granted);
  std::set<UnitRef> leased;
  for (const scheduler::GrantedLease& lease : granted) leased.insert(lease.unit);
  v1::CoordinatorMessage message;
  for (const UnitInHand& unit : units) {
    if (leased.contains(unit.unit)) continue;
    v1::Lease* lease = message.mutable_void_leases()->add_leases();
    *lease->mutable_unit() = ProtoFromUnit(unit.unit);
    lease->set_attempt(unit.attempt.value());
  }
  if (message.has_void_leases()) workers_.at(worker).sink->Send(message);
}

void Coordinator::MoveWorkers(int count, const std::string& address) {
  absl::MutexLock lock(&mutex_);
  std::vector<scheduler::WorkerInfo> movable = scheduler_.Workers(WorkerId(0), kMaxMovable);
  std::erase_if(movable, [](const scheduler::WorkerInfo& worker) {
    return worker.state != v1::WORKER_STATE_IDLE && worker.state != v1::WORKER_STATE_BUSY;
  });
  std::stable_sort(movable.begin(), movable.end(),
                   [](const auto& a, const auto& b) { return a.leases < b.leases; });
  movable.resize(std::min(movable.size(), static_cast<size_t>(std::max(count, 0))));
  for (const scheduler::WorkerInfo& worker : movable) MoveWorker(worker.worker, address);
}

void Coordinator::SendWorkersAway(const std::string& address) {
  absl::MutexLock lock(&mutex_);
  for (const auto& [worker, connected] : workers_) MoveWorker(worker, address, /*at_once=*/true);
}

void Coordinator::MoveWorker(WorkerId worker, const std::string& address, bool at_once) {
  options_.log->info("event=worker_moved worker={} address={} at_once={}", NameOf(worker),
                     logging::Quoted(address), at_once);
  scheduler_.DrainWorker(worker);
  v1::CoordinatorMessage message;
  message.mutable_move()->set_address(address);
  message.mutable_move()->set_at_once(at_once);
  workers_.at(worker).sink->Send(message);
}

void Coordinator::MoveWorkersWith(const job::JobId& job, const std::string& address) {
  absl::MutexLock lock(&mutex_);
  const auto units = in_hand_.find(job);
  if (units == in_hand_.end()) return;
  std::set<WorkerId> workers;
  for (const UnitInHand& unit : units->second) workers.insert(unit.worker);
  for (const WorkerId& worker : workers) MoveWorker(worker, address);
  ForgetInHand([&workers](const UnitInHand& unit) { return workers.contains(unit.worker); });
}

}  // namespace lumifold::server
