// Workers: what connects, what it says of its leases, and what operators decide about it.
#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

namespace {

const Attempt kFirstAttempt(std::numeric_limits<int64_t>::min());

}  // namespace

void Scheduler::AddWorker(WorkerId worker, const WorkerTraits& traits) {
  WorkerTraits named = traits;
  if (named.name.empty()) named.name = job::TextOf(worker);
  EndEarlierConnection(worker, named);
  workers_.Add(worker, named);
  TakeBackLosses(worker);
  if (!blocked_.contains(named.name)) return;
  workers_.Change(worker, [](Worker& state) { state.blocked = true; });
}

void Scheduler::EndEarlierConnection(WorkerId worker, const WorkerTraits& traits) {
  if (traits.instance == 0) return;
  const auto [connection, is_first] = connections_.try_emplace(traits.instance, worker);
  if (is_first) return;
  const WorkerId earlier = std::exchange(connection->second, worker);
  if (workers_.Find(earlier)->traits.name != traits.name) return;  // not the same process, whatever it says
  DrainWorker(earlier);
  for (const Attempt attempt : leases_.OfWorker(earlier)) {
    if (VoidLease(attempt)) ++retries_[RetryReason::kWorkerLost];
  }
}

std::vector<FailedJob> Scheduler::RemoveWorker(WorkerId worker) {
  std::vector<FailedJob> failed;
  if (const Worker* state = workers_.Find(worker); state != nullptr) {
    const auto connection = connections_.find(state->traits.instance);
    if (connection != connections_.end() && connection->second == worker) connections_.erase(connection);
  }
  CancelReservation(worker);
  for (const Attempt attempt : leases_.OfWorker(worker)) {
    const Lease lease = *leases_.Find(attempt);
    std::string error = CountLoss(lease);
    NoteAbsence(lease);
    if (!error.empty()) failed.push_back({jobs_.at(lease.unit.job).id, std::move(error)});
    if (VoidLease(attempt)) ++retries_[RetryReason::kWorkerLost];
  }
  stalled_.erase(stalled_.lower_bound({worker, kFirstAttempt}),
                 stalled_.lower_bound({WorkerId(worker.value() + 1), kFirstAttempt}));
  reservations_.erase(worker);
  workers_.Remove(worker);
  return failed;
}

void Scheduler::DrainWorker(WorkerId worker) {
  CancelReservation(worker);
  workers_.Change(worker, [](Worker& state) { state.draining = true; });
}

void Scheduler::BlockWorker(const std::string& name, const std::string& reason) {
  blocked_[name] = reason;
  for (const WorkerId worker : workers_.Named(name)) {
    CancelReservation(worker);
    workers_.Change(worker, [](Worker& state) { state.blocked = true; });
    for (const Attempt attempt : leases_.OfWorker(worker)) {
      if (RevokeLease(attempt)) ++retries_[RetryReason::kWorkerBlocked];
    }
  }
}

bool Scheduler::ReadmitWorker(const std::string& name) {
  const bool was_blocked = blocked_.erase(name) > 0;
  const std::vector<WorkerId> connected = workers_.Named(name);
  for (const WorkerId worker : connected) {
    workers_.Change(worker, [](Worker& state) {
      state.blocked = false;
      state.draining = false;
      state.set_aside_until = absl::InfinitePast();
      state.blamed_jobs.clear();
    });
  }
  return was_blocked || !connected.empty();
}

bool Scheduler::HandBack(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  if (!HoldsLease(worker, unit, attempt)) return false;
  if (VoidLease(attempt)) ++retries_[RetryReason::kHandedBack];
  return true;
}

std::vector<LateLease> Scheduler::Heartbeat(WorkerId worker, absl::Span<const HeldLease> held, Attempt newest,
                                            absl::Time now) {
  latest_ = std::max(latest_, now);
  if (const Worker* state = workers_.Find(worker); state != nullptr && state->unresponsive) {
    workers_.Change(worker, [](Worker& changed) { changed.unresponsive = false; });
    TakeBackLosses(worker);
  }
  std::map<Attempt, int64_t> progress;
  for (const HeldLease& lease : held) progress.emplace(lease.attempt, lease.progress);
  std::vector<LateLease> dropped;
  for (const Attempt attempt : leases_.OfWorker(worker)) {
    const auto named = progress.find(attempt);
    if (named != progress.end()) {
      Renew(attempt, named->second, now);
    } else if (attempt <= newest) {
      dropped.push_back(Drop(attempt));
    }
  }
  for (auto it = stalled_.lower_bound({worker, kFirstAttempt});
       it != stalled_.end() && it->first == worker && it->second <= newest;) {
    if (progress.contains(it->second)) {
      ++it;
      continue;
    }
    ReleaseSlot(worker);
    it = stalled_.erase(it);
  }
  return dropped;
}

LateLease Scheduler::Drop(Attempt attempt) {
  Lease lease = *leases_.Find(attempt);
  lease.received = true;
  LateLease dropped{RefOf(lease.unit), lease.worker, Lateness::kDropped, CountLoss(lease)};
  if (lease.audit) {
    jobs_.at(lease.unit.job)
        .audits.at(lease.unit.place)
        .declined.insert(workers_.Find(lease.worker)->traits.name);
    VoidLease(attempt);
    return dropped;
  }
  // As after a failure: otherwise a worker that drops the first free unit would get it again and again.
  History& history = jobs_.at(lease.unit.job).history[lease.unit.place];
  history.last_failed = workers_.Find(lease.worker)->traits.name;
  history.failed_workers.insert(lease.worker);
  if (VoidLease(attempt)) ++retries_[RetryReason::kDropped];
  return dropped;
}

void Scheduler::Renew(Attempt attempt, int64_t progress, absl::Time now) {
  Lease lease = *leases_.Find(attempt);
  if (progress != lease.progress) lease.progressed = now;
  lease.received = true;
  lease.progress = progress;
  lease.deadline = std::min(now + options_.lease, lease.progressed + options_.stall);
  leases_.Update(attempt, lease);
}

std::vector<LateLease> Scheduler::ExpireLeases(absl::Time now) {
  latest_ = std::max(latest_, now);
  ReturnDelayed(now);
  ExpireAudits(now);
  Readmit(now);
  std::vector<LateLease> late;
  for (const Attempt attempt : leases_.Expired(now)) {
    const Lease lease = *leases_.Find(attempt);
    const bool stalled = lease.deadline >= lease.progressed + options_.stall;
    late.push_back({RefOf(lease.unit), lease.worker, stalled ? Lateness::kStalled : Lateness::kSilent,
                    CountLoss(lease)});
    if (stalled) {
      workers_.TakeSlot(lease.worker);
      stalled_.emplace(lease.worker, attempt);
    } else {
      NoteAbsence(lease);
      CancelReservation(lease.worker);
      workers_.Change(lease.worker, [](Worker& worker) { worker.unresponsive = true; });
    }
    ++leases_expired_;
    if (RevokeLease(attempt)) ++retries_[stalled ? RetryReason::kStalled : RetryReason::kExpired];
  }
  for (const Attempt attempt : leases_.Checks(now)) {
    MarkLate(attempt, *leases_.Find(attempt), now);
    Lease lease = *leases_.Find(attempt);
    if (!lease.is_late || lease.check > now) continue;
    lease.check = OverdueTime(lease.unit, lease.granted);  // the mean may have risen since
    lease.is_overdue = lease.check <= now;
    if (lease.is_overdue) lease.check = absl::InfiniteFuture();
    leases_.Update(attempt, lease);
    if (!lease.is_overdue || !MayReturn(lease.unit)) continue;
    Return(lease.unit);
    ++retries_[RetryReason::kOverdue];
    late.push_back({RefOf(lease.unit), lease.worker, Lateness::kOverdue, ""});
  }
  return late;
}

absl::Time Scheduler::NextExpiry() const {
  absl::Time next = std::min(leases_.NextTime(), workers_.NextReadmission());
  if (!audit_deadlines_.empty()) next = std::min(next, audit_deadlines_.begin()->first);
  return delayed_.empty() ? next : std::min(next, delayed_.begin()->first);
}

WorkerInfo Scheduler::InfoOf(WorkerId id, const Worker& worker) const {
  WorkerInfo info{.worker = id, .traits = worker.traits, .state = StateOf(worker)};
  const auto blocked = blocked_.find(worker.traits.name);
  info.reason = blocked == blocked_.end() ? SetAsideReason(id) : blocked->second;
  std::set<job::JobId> jobs;
  for (const Attempt attempt : leases_.OfWorker(id)) {
    ++info.leases;
    jobs.insert(jobs_.at(leases_.Find(attempt)->unit.job).id);
  }
  info.jobs.assign(jobs.begin(), jobs.end());
  info.units_done = worker.units_done;
  info.units_failed = worker.units_failed;
  if (worker.units_done > 0) info.mean_time = worker.unit_time / worker.units_done;
  return info;
}

std::optional<WorkerInfo> Scheduler::DescribeWorker(WorkerId id) const {
  const Worker* worker = workers_.Find(id);
  return worker == nullptr ? std::nullopt : std::optional(InfoOf(id, *worker));
}

std::vector<WorkerInfo> Scheduler::Workers(WorkerId after, int limit) const {
  std::vector<WorkerInfo> infos;
  for (const WorkerId id : workers_.After(after, limit)) infos.push_back(InfoOf(id, *workers_.Find(id)));
  return infos;
}

std::vector<BlockedWorker> Scheduler::Blocked() const {
  std::vector<BlockedWorker> blocked;
  for (const auto& [name, reason] : blocked_) blocked.push_back({name, reason});
  return blocked;
}

}  // namespace lumifold::scheduler
