#include "server/scheduler/leasing.h"

#include <algorithm>
#include <utility>

namespace lumifold::scheduler {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

Leasing::Leasing(State* state) : state_(state), next_attempt_(state->options.first_attempt.value()) {}

GrantedLease Leasing::Grant(const UnitIndex& unit, WorkerId worker, absl::Time now, Kind kind) {
  const Attempt attempt = NextAttempt();
  const double slowness = state_->workers.Find(worker)->slowness;
  Lease lease{.unit = unit,
              .worker = worker,
              .granted = now,
              .deadline = now + std::min(state_->options.lease, state_->options.stall),
              .progressed = now,
              .alone = kind == Kind::kAlone,
              .audit = kind == Kind::kAudit};
  state_->second_leases.Schedule(state_->KindOf(unit), slowness, &lease);
  state_->leases.Add(attempt, lease);
  state_->ready.Granted(unit.job, now);
  state_->workers.Change(worker, [&](Worker& changed) {
    ++changed.busy;
    changed.last_job = unit.job;
  });
  Job& job = state_->jobs.Get(unit.job);
  ++job.leases.count;
  if (kind != Kind::kAudit && state_->leases.OfUnit(unit).size() == 1) ++job.leases.units;
  ++job.leases.holders[worker];
  state_->UpdateReady(job);
  const UnitRef ref = state_->jobs.RefOf(unit);
  return {.worker = worker,
          .unit = ref,
          .attempt = attempt,
          .rect = job.units.of_frame().tiles().RectOf(ref.key.tile),
          .samples = job.frames.SamplesOf(unit.place, job.units),
          .alone = kind == Kind::kAlone,
          .audit = kind == Kind::kAudit,
          .keep = state_->jobs.kept().Has({unit.job, unit.place.frame})};
}

Lease Leasing::Remove(Attempt attempt) {
  const Lease lease = state_->leases.Remove(attempt);
  Job& job = state_->jobs.Get(lease.unit.job);
  --job.leases.count;
  if (!lease.audit && state_->leases.OfUnit(lease.unit).empty()) --job.leases.units;
  state_->ready.Ended(lease.unit.job, state_->latest - lease.granted);
  if (lease.is_late) state_->second_leases.Remove(state_->RequirementOf(job), lease.expected_end, attempt);
  const auto holder = job.leases.holders.find(lease.worker);
  if (--holder->second == 0) job.leases.holders.erase(holder);
  if (job.leases.limit > 0) state_->UpdateReady(job);
  return lease;
}

void Leasing::Release(Attempt attempt, std::optional<RetryReason> reason) {
  const Lease lease = Remove(attempt);
  ReleaseSlot(lease.worker);
  if (lease.audit) return ReturnAudit(lease.unit);
  if (!MayReturn(lease.unit)) return;
  Return(lease.unit);
  if (reason.has_value()) CountRetry(*reason);
}

void Leasing::Revoke(Attempt attempt, std::optional<RetryReason> reason) {
  AddRevoked(attempt);
  Release(attempt, reason);
}

void Leasing::RevokeOfJob(int64_t job) {
  for (const Attempt attempt : state_->leases.OfJob(job)) {
    AddRevoked(attempt);
    ReleaseSlot(Remove(attempt).worker);
  }
}

void Leasing::AddRevoked(Attempt attempt) {
  const Lease& lease = *state_->leases.Find(attempt);
  revoked_.push_back({lease.worker, state_->jobs.RefOf(lease.unit), attempt});
}

std::vector<RevokedLease> Leasing::TakeRevoked() { return std::exchange(revoked_, {}); }

void Leasing::ReleaseSlot(WorkerId worker) {
  state_->workers.ReleaseSlot(worker);
  state_->quarantine.EndIfIdle(worker);
}

bool Leasing::MayReturn(const UnitIndex& unit) const {
  const std::vector<Attempt> attempts = state_->leases.OfUnit(unit);
  return attempts.size() < kMaxLeasesOfUnit &&
         std::all_of(
             attempts.begin(), attempts.end(),
             [this](Attempt attempt) { return state_->leases.Find(attempt)->is_overdue; });
}

void Leasing::Return(const UnitIndex& unit) {
  if (const auto keeper = state_->jobs.kept().KeeperOf({unit.job, unit.place.frame}); keeper.has_value())
    return state_->jobs.kept().BreakOf(unit.job, *keeper);  // free once the frame is kept no more
  if (state_->quarantine.IsSuspect(unit)) return state_->quarantine.Enter(unit);
  Job& job = state_->jobs.Get(unit.job);
  job.free.Return(unit.place);
  state_->UpdateReady(job);
}

void Leasing::ReturnAudit(const UnitIndex& unit) {
  if (state_->audits.Return(unit)) state_->UpdateReady(state_->jobs.Get(unit.job));
}

}  // namespace lumifold::scheduler
