#include "server/scheduler/units.h"

#include <cstddef>
#include <optional>
#include <utility>

#include "filter/image/check.h"
#include "server/job/plan.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

Units::Units(State* state, Frames* frames, Leasing* leasing, Audits* audits, Disputes* disputes)
    : state_(state), frames_(frames), leasing_(leasing), audits_(audits), disputes_(disputes) {}

bool Units::HoldsLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  return state_->FindLease(worker, unit, attempt) != nullptr;
}

TileSamples Units::SamplesOf(const UnitRef& unit) const {
  const std::optional<UnitIndex> index = state_->jobs.IndexOf(unit);
  LUMIFOLD_CHECK(index.has_value());
  const Job& job = state_->jobs.Get(index->job);
  return job.frames.SamplesOf(index->place, job.units);
}

Completion Units::Complete(WorkerId worker, const UnitRef& unit, Attempt attempt, absl::Time now,
                           absl::string_view digest, const UnitCost& cost) {
  state_->SetTime(now);
  const std::optional<UnitIndex> index = state_->jobs.IndexOf(unit);
  if (!index.has_value()) return Completion::kUnknown;
  Job& job = state_->jobs.Get(index->job);
  const bool holds_lease = HoldsLease(worker, unit, attempt);
  if (job.frames.HasResult(index->place)) {
    if (!holds_lease) return Completion::kDuplicate;
    audits_->Complete(attempt, digest, now);
    return Completion::kAudited;
  }
  if (!holds_lease) return Completion::kStale;
  OnAccepted(leasing_->Remove(attempt), cost, now);
  job.is_bound = true;
  const WorkerTraits& traits = state_->workers.Find(worker)->traits;
  if (state_->RequirementOf(job).numeric_class.empty()) Bind(job, traits.numeric_class);
  if (state_->accepted.Add(*index, worker, cost.bytes)) leasing_->ReleaseSlot(worker);
  FrameState& frame = *job.frames.Find(index->place.frame);
  const auto number = static_cast<size_t>(index->place.number);
  frame.taken[number] = true;
  frame.deliverers[number] = state_->deliverers.Acquire(traits.name);
  audits_->Begin(*index, traits.name, digest, now);
  return Completion::kAccepted;
}

void Units::OnAccepted(const Lease& lease, const UnitCost& cost, absl::Time now) {
  const absl::Duration time = now - lease.granted;
  const std::optional<absl::Duration> mean = state_->second_leases.MeanOf(state_->KindOf(lease.unit));
  state_->workers.Change(lease.worker, [&](Worker& changed) {
    ++changed.units.done;
    changed.units.time += time;
    changed.ahead.AddUnit(cost.rendering, cost.bytes);
    if (mean.has_value() && *mean > absl::ZeroDuration()) SecondLeases::Rate(time, *mean, &changed);
  });
  CountTime(lease, now);
  if (const Worker& worker = *state_->workers.Find(lease.worker); worker.units.done == 1)
    state_->evidence.AddWitness(worker.traits.party);  // of later connections, too
  for (const WorkerId failed : state_->evidence.Refute(lease.unit)) {
    if (failed != lease.worker) state_->health.Attribute(failed, lease.unit.job, now);
  }
  state_->backoffs.End(lease.unit);
  RevokeOtherLeases(lease.unit);
}

void Units::CountTime(const Lease& lease, absl::Time now) {
  if (!state_->second_leases.CountTime(state_->KindOf(lease.unit), now - lease.granted)) return;
  for (const Attempt attempt : state_->leases.OfJob(lease.unit.job)) {
    Lease other = *state_->leases.Find(attempt);
    const double slowness = state_->workers.Find(other.worker)->slowness;
    state_->second_leases.Schedule(state_->KindOf(other.unit), slowness, &other);
    state_->leases.Update(attempt, other);
  }
}

void Units::RevokeOtherLeases(const UnitIndex& unit) {
  for (const Attempt attempt : state_->leases.OfUnit(unit)) leasing_->Revoke(attempt, std::nullopt);
  Job& job = state_->jobs.Get(unit.job);
  job.free.Withdraw(unit.place);
  state_->UpdateReady(job);
  state_->quarantine.Forget(unit);
}

void Units::Bind(Job& job, const std::string& numeric_class) {
  Requirement requirement = state_->RequirementOf(job);
  requirement.numeric_class = numeric_class;
  Require(job, requirement);
  for (const Attempt attempt : state_->leases.OfJob(job.number)) {
    const WorkerId worker = state_->leases.Find(attempt)->worker;
    if (state_->workers.Find(worker)->traits.numeric_class != numeric_class)
      leasing_->Revoke(attempt, RetryReason::kOtherClass);
  }
}

void Units::RequireMemory(Job& job) {
  Requirement requirement = state_->RequirementOf(job);
  requirement.memory_bytes = state_->ready.memory().Of(job.number).bytes();
  Require(job, requirement);
}

void Units::Require(Job& job, const Requirement& requirement) {
  if (requirement == state_->RequirementOf(job)) return;
  frames_->CountActive(job, false);
  state_->jobs.kept().BreakOf(job.number);
  for (const Attempt attempt : state_->leases.OfJob(job.number)) {
    Lease lease = *state_->leases.Find(attempt);
    if (!lease.is_late) continue;  // it stood still
    state_->second_leases.Remove(state_->RequirementOf(job), lease.expected_end, attempt);
    lease.is_late = false;  // it is late again at the next check
    lease.check = state_->latest;
    state_->leases.Update(attempt, lease);
  }
  state_->ready.SetRequirement(job.number, requirement, state_->latest);
  frames_->CountActive(job, true);
  state_->UpdateReady(job);
}

bool Units::Fail(WorkerId worker, const UnitRef& unit, Attempt attempt, const UnitFailure& failure,
                 absl::Time now) {
  state_->SetTime(now);
  if (!HoldsLease(worker, unit, attempt)) return false;
  const Lease lease = leasing_->Remove(attempt);
  if (lease.audit) {
    audits_->Decline(lease.unit, worker);
    leasing_->ReleaseSlot(worker);
    return true;
  }
  if (const Worker& failed = *state_->workers.Find(worker);
      failure.out_of_memory && failed.traits.memory_bytes > 0) {
    ReturnToLarger(lease, failed, now);
    return true;
  }
  const int failures = state_->evidence
                           .AddFailure(lease.unit, worker, *state_->workers.Find(worker), failure.permanent,
                                       failure.error, now)
                           .failures;
  state_->workers.Change(worker, [](Worker& changed) { ++changed.units.failed; });
  leasing_->ReleaseSlot(worker);
  if (leasing_->MayReturn(lease.unit)) {
    // Whoever calls it impossible gets it no more: another one is asked at once.
    ReturnAfter(lease.unit, failure.permanent ? absl::ZeroDuration() : state_->backoffs.LengthAfter(failures),
                now);
    leasing_->CountRetry(RetryReason::kFailed);
  }
  disputes_->Judge(lease.unit, now);
  return true;
}

void Units::ReturnToLarger(const Lease& lease, const Worker& worker, absl::Time now) {
  state_->ready.memory().RanOut(lease.unit.job, worker.traits.name,
                                state_->workers.KindOf(worker.kind).memory_bytes,
                                now + state_->options.cool_down);
  RequireMemory(state_->jobs.Get(lease.unit.job));
  state_->workers.Change(lease.worker, [](Worker& changed) { ++changed.units.failed; });
  leasing_->ReleaseSlot(lease.worker);
  if (!leasing_->MayReturn(lease.unit)) return;
  leasing_->Return(lease.unit);
  leasing_->CountRetry(RetryReason::kFailed);
}

void Units::ReturnAfter(const UnitIndex& unit, absl::Duration pause, absl::Time now) {
  const bool is_kept =
      state_->jobs.kept().Has({unit.job, unit.place.frame});  // all units of its frame come back
  if (pause <= absl::ZeroDuration() || is_kept) return leasing_->Return(unit);
  state_->backoffs.Begin(unit, now + pause);
}

void Units::EndPauses(absl::Time now) {
  for (const UnitIndex& unit : state_->backoffs.TakeEnded(now)) {
    if (leasing_->MayReturn(unit)) leasing_->Return(unit);
  }
  for (const int64_t job : state_->ready.memory().TakeEnded(now)) RequireMemory(state_->jobs.Get(job));
}

bool Units::HandBack(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  if (!HoldsLease(worker, unit, attempt)) return false;
  leasing_->Release(attempt, RetryReason::kHandedBack);
  return true;
}

bool Units::Commit(const UnitRef& unit) {
  const std::optional<UnitIndex> index = state_->jobs.IndexOf(unit);
  if (!index.has_value()) return false;  // the job ended while the unit was being committed
  EndAccepted(*index);
  Job& job = state_->jobs.Get(index->job);
  job.frames.Commit(index->place, job.units);
  const bool is_frame_committed = frames_->UpdateCommitted(job, index->place.frame);
  audits_->OnCommitted(*index);
  return is_frame_committed;
}

void Units::EndAccepted(const UnitIndex& unit) {
  if (const std::optional<WorkerId> worker = state_->accepted.Remove(unit))
    leasing_->ReleaseSlot(*worker);  // it may have disconnected since
}

void Units::SetPlan(const UnitRef& unit, const v1::JobSpec& planned) {
  const std::optional<UnitIndex> index = state_->jobs.IndexOf(unit);
  if (!index.has_value()) return;
  EndAccepted(*index);
  Job& job = state_->jobs.Get(index->job);
  frames_->Leave(job);
  state_->second_leases.ForgetTimes(job.number);
  state_->backoffs.ForgetJob(job.number);
  job.units = JobUnits(planned);
  job.frames = JobFrames(job.units.frames().count());
  job.free = FreeUnits();
  state_->UpdateReady(job);
  state_->ready.memory().SetPlanned(job.number, job::MemoryNeedOf(planned));
  RequireMemory(job);
}

bool Units::Revoke(const UnitRef& unit) {
  const std::optional<UnitIndex> index = state_->jobs.IndexOf(unit);
  if (!index.has_value() || state_->accepted.Has(*index)) return false;
  Job& job = state_->jobs.Get(index->job);
  const Place& place = index->place;
  FrameState* const frame = job.frames.Find(place.frame);  // a finished frame has none
  if (frame == nullptr || !frame->taken[static_cast<size_t>(place.number)]) return false;
  frame->taken[static_cast<size_t>(place.number)] = false;
  frame->revoking.erase(place.number);
  state_->deliverers.Release(std::exchange(frame->deliverers[static_cast<size_t>(place.number)], 0));
  job.frames.Revoke(place, job.units);  // before the end of its audit, which may commit the frame
  audits_->End(*index);
  for (const Attempt audit : state_->leases.OfUnit(*index)) leasing_->Revoke(audit, std::nullopt);
  frames_->UpdateCommitted(job, place.frame);
  if (!job.free.IsInOrder(place, job.units)) job.free.Return(place);  // otherwise it is leased in its turn
  state_->UpdateReady(job);
  leasing_->CountRetry(RetryReason::kTakenBack);
  return true;
}

void Units::ReturnOutOfOrder(Job& job, int frame) {
  bool is_in_order = true;
  for (int earlier = job.free.next().frame; earlier < frame; ++earlier)
    is_in_order &= job.frames.IsActive(earlier) || job.frames.IsOver(earlier);
  if (is_in_order) return;
  job.free.Pass(frame);
  for (int64_t number = 0; number < job.units.ordered(); ++number) job.free.Return({frame, number});
}

bool Units::Restore(const JobId& id, const RestoredUnit& unit, absl::Time now) {
  state_->SetTime(now);
  const std::optional<UnitIndex> index = state_->jobs.IndexOf({id, unit.key});
  if (!index.has_value()) return false;
  Job& job = state_->jobs.Get(index->job);
  if (job.frames.IsOver(index->place.frame)) return true;  // counted with its frame
  const bool is_first = !job.frames.IsActive(index->place.frame);
  FrameState& frame = frames_->Open(job, index->place.frame);
  if (is_first) ReturnOutOfOrder(job, index->place.frame);
  const auto number = static_cast<size_t>(index->place.number);
  if (frame.rounds != nullptr && !frame.rounds->Has(unit.key)) return false;
  if (frame.taken[number]) return true;
  frame.taken[number] = true;
  job.free.Withdraw(index->place);
  if (!unit.worker.empty()) frame.deliverers[number] = state_->deliverers.Acquire(unit.worker);
  job.frames.Commit(index->place, job.units);
  frames_->UpdateCommitted(job, index->place.frame);
  audits_->Begin(*index, unit.worker, unit.digest, now);
  state_->UpdateReady(job);
  return true;
}

}  // namespace lumifold::scheduler
