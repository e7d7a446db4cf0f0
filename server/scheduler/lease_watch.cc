#include "server/scheduler/lease_watch.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::WorkerId;

namespace {

/// Names of lost workers in an error.
constexpr size_t kMaxNames = 4;

const Attempt kFirstAttempt(std::numeric_limits<int64_t>::min());

}  // namespace

std::vector<LateLease> LeaseWatch::Heartbeat(WorkerId worker, absl::Span<const HeldLease> held,
                                             Attempt newest, absl::Time now) {
  state_->SetTime(now);
  if (const Worker* state = state_->workers.Find(worker); state != nullptr && state->unresponsive) {
    state_->workers.Change(worker, [](Worker& changed) { changed.unresponsive = false; });
    TakeBackLosses(worker);
  }
  std::map<Attempt, int64_t> progress;
  for (const HeldLease& lease : held) progress.emplace(lease.attempt, lease.progress);
  std::vector<LateLease> dropped;
  for (const Attempt attempt : state_->leases.OfWorker(worker)) {
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
    leasing_->ReleaseSlot(worker);
    it = stalled_.erase(it);
  }
  return dropped;
}

void LeaseWatch::Renew(Attempt attempt, int64_t progress, absl::Time now) {
  Lease lease = *state_->leases.Find(attempt);
  if (progress != lease.progress) lease.progressed = now;
  if (!lease.received)
    state_->workers.Change(lease.worker,
                           [&](Worker& worker) { worker.ahead.AddRoundTrip(now - lease.granted); });
  lease.received = true;
  lease.progress = progress;
  lease.deadline = std::min(now + state_->options.lease, lease.progressed + state_->options.stall);
  state_->leases.Update(attempt, lease);
}

LateLease LeaseWatch::Drop(Attempt attempt) {
  Lease lease = *state_->leases.Find(attempt);
  lease.received = true;
  CountLoss(lease);
  // As after a failure: otherwise a worker that drops the first free unit would get it again and again.
  if (lease.audit) {
    state_->audits.Decline(lease.unit, state_->workers.Find(lease.worker)->traits.name);
  } else {
    state_->evidence.AddDrop(lease.unit, lease.worker, *state_->workers.Find(lease.worker));
  }
  leasing_->Release(attempt, RetryReason::kDropped);
  return {state_->jobs.RefOf(lease.unit), lease.worker, Lateness::kDropped};
}

std::vector<LateLease> LeaseWatch::Expire(absl::Time now) {
  state_->SetTime(now);
  std::vector<LateLease> late;
  for (const Attempt attempt : state_->leases.Expired(now)) late.push_back(End(attempt));
  for (const Attempt attempt : state_->leases.Checks(now)) {
    const Lease lease = *state_->leases.Find(attempt);
    if (!BecomesOverdue(attempt, now)) continue;
    late.push_back({state_->jobs.RefOf(lease.unit), lease.worker, Lateness::kOverdue});
  }
  return late;
}

LateLease LeaseWatch::End(Attempt attempt) {
  const Lease lease = *state_->leases.Find(attempt);
  const bool stalled = lease.deadline >= lease.progressed + state_->options.stall;
  CountLoss(lease);
  if (stalled) {
    state_->workers.TakeSlot(lease.worker);
    stalled_.emplace(lease.worker, attempt);
  } else {
    NoteAbsence(lease);
    state_->quarantine.Cancel(lease.worker);
    state_->workers.Change(lease.worker, [](Worker& worker) { worker.unresponsive = true; });
  }
  ++expired_;
  leasing_->Revoke(attempt, stalled ? RetryReason::kStalled : RetryReason::kExpired);
  return {state_->jobs.RefOf(lease.unit), lease.worker, stalled ? Lateness::kStalled : Lateness::kSilent};
}

void LeaseWatch::EndLateAudit(Attempt attempt) {
  const Lease lease = *state_->leases.Find(attempt);
  state_->audits.Decline(lease.unit, state_->workers.Find(lease.worker)->traits.name);
  // A thread may still hang in it.
  state_->workers.TakeSlot(lease.worker);
  stalled_.emplace(lease.worker, attempt);
  leasing_->Revoke(attempt, RetryReason::kOverdue);
}

bool LeaseWatch::BecomesOverdue(Attempt attempt, absl::Time now) {
  Lease lease = *state_->leases.Find(attempt);
  const SecondLeases::Kind kind = state_->KindOf(lease.unit);
  if (lease.alone || lease.audit) {
    const bool is_overdue = state_->second_leases.MarkOnlyOverdue(kind, now, &lease);
    state_->leases.Update(attempt, lease);
    if (!is_overdue) return false;
    if (lease.audit) {
      EndLateAudit(attempt);
      return true;
    }
    return ReturnOverdue(lease.unit);
  }
  const double slowness = state_->workers.Find(lease.worker)->slowness;
  const bool is_late = state_->second_leases.MarkLate(kind, slowness, now, &lease);
  const bool is_overdue = state_->second_leases.MarkOverdue(kind, now, &lease);
  state_->leases.Update(attempt, lease);
  if (is_late && state_->leases.OfUnit(lease.unit).size() == 1)
    state_->second_leases.Enter(state_->ready.RequirementOf(lease.unit.job), lease.expected_end, attempt);
  return is_overdue && ReturnOverdue(lease.unit);
}

bool LeaseWatch::ReturnOverdue(const UnitIndex& unit) {
  if (!leasing_->MayReturn(unit)) return false;
  leasing_->Return(unit);
  leasing_->CountRetry(RetryReason::kOverdue);
  return true;
}

void LeaseWatch::CountLoss(const Lease& lease) {
  if (lease.audit || !lease.received) return;  // a worker has rendered the unit; or this one did not begin it
  const Worker& worker = *state_->workers.Find(lease.worker);
  state_->quarantine.AddLoss(lease.unit, worker.traits.party);
  if (!lease.alone) return;
  const Quarantine::Losses losses = state_->quarantine.LossesOf(lease.unit);
  std::vector<std::string> names;
  for (auto it = losses.begin(); it != losses.end(); it = losses.upper_bound(*it)) names.push_back(*it);
  if (names.size() > kMaxNames) names.resize(kMaxNames);
  const std::string error =
      absl::StrCat(Describe(state_->jobs.RefOf(lease.unit)), ": workers were lost with it ", losses.size(),
                   " times, the last one while it rendered nothing else: ", absl::StrJoin(names, ", "));
  for (const std::string& party : losses) state_->evidence.AddLoss(lease.unit, party, error, state_->latest);
  disputes_->Judge(lease.unit, state_->latest);
}

void LeaseWatch::NoteAbsence(const Lease& lease) {
  if (!lease.audit)
    state_->quarantine.NoteAbsence(state_->workers.Find(lease.worker)->traits.instance, lease.unit);
}

void LeaseWatch::TakeBackLosses(WorkerId worker) {
  const WorkerTraits& traits = state_->workers.Find(worker)->traits;
  for (const UnitIndex& unit : state_->quarantine.TakeBackLosses(traits.instance, traits.party)) {
    state_->evidence.RetractLoss(unit, traits.party);
    if (state_->quarantine.Release(unit)) leasing_->Return(unit);
  }
}

void LeaseWatch::Remove(WorkerId worker) {
  stalled_.erase(stalled_.lower_bound({worker, kFirstAttempt}),
                 stalled_.lower_bound({WorkerId(worker.value() + 1), kFirstAttempt}));
}

}  // namespace lumifold::scheduler
