#include "server/scheduler/audits.h"

#include <cstddef>
#include <cstdint>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::UnitRef;
using job::WorkerId;

namespace {

/// FNV-1a, 64 bits: the choice of units must be the same in every run and on every machine.
uint64_t HashOf(const UnitRef& unit) {
  const std::string text = job::Describe(unit);
  uint64_t hash = 14695981039346656037u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211u;
  hash ^= hash >> 33;  // the last characters must reach the high bits
  hash *= 0xff51afd7ed558ccdu;
  return hash ^ (hash >> 33);
}

}  // namespace

bool IsAudited(const UnitRef& unit, double share) {
  constexpr double kRange = 18446744073709551616.0;  // 2^64
  if (unit.key.kind == v1::UNIT_KIND_PLAN) return false;
  return share > 0 && static_cast<double>(HashOf(unit)) < share * kRange;
}

Audits::Audits(State* state, Frames* frames, Leasing* leasing, Workers* workers)
    : state_(state), frames_(frames), leasing_(leasing), workers_(workers) {}

void Audits::Begin(const UnitIndex& unit, const std::string& worker, absl::string_view digest,
                   absl::Time now) {
  Job& job = state_->jobs.Get(unit.job);
  if (!IsAudited(state_->jobs.RefOf(unit), job.audit_share)) return;
  if (!state_->audits.Begin(unit, worker, digest, now)) return;
  frames_->UpdateCommitted(job, unit.place.frame);
  state_->UpdateReady(job);
}

void Audits::Decline(const UnitIndex& unit, WorkerId worker) {
  state_->audits.Decline(unit, state_->workers.Find(worker)->traits.name);
  state_->workers.Change(worker, [](Worker& changed) { ++changed.units.failed; });
  leasing_->ReturnAudit(unit);
}

void Audits::Complete(Attempt attempt, absl::string_view digest, absl::Time now) {
  const Lease lease = leasing_->Remove(attempt);
  leasing_->ReleaseSlot(lease.worker);
  const std::string& name = state_->workers.Find(lease.worker)->traits.name;
  const AuditBook::Verdict verdict = state_->audits.Vote(lease.unit, name, digest, now);
  if (verdict.outcome == AuditBook::Outcome::kOpen)
    return state_->UpdateReady(state_->jobs.Get(lease.unit.job));
  for (const std::string& wrong : verdict.wrong) {
    BlockFaulty(wrong, absl::StrCat("it delivered other pixels than two other workers for ",
                                    job::Describe(state_->jobs.RefOf(lease.unit))));
  }
  End(lease.unit);
}

void Audits::BlockFaulty(const std::string& worker, const std::string& reason) {
  const bool was_blocked = state_->health.IsBlocked(worker);
  workers_->Block(worker, reason);
  FaultyWorker faulty{.name = worker, .reason = reason, .units = {}};
  const uint32_t number = state_->deliverers.Find(worker);
  for (auto& [job_number, job] : state_->jobs.all()) {
    for (const auto& [frame_index, active] : job.frames.active()) {
      FrameState& frame = *job.frames.Find(frame_index);
      for (size_t i = 0; number != 0 && i < frame.deliverers.size(); ++i) {
        if (frame.deliverers[i] != number) continue;
        const UnitIndex unit{job_number, {frame_index, static_cast<int64_t>(i)}};
        frame.revoking.insert(unit.place.number);
        if (!state_->accepted.Has(unit))
          faulty.units.push_back(state_->jobs.RefOf(unit));  // otherwise OnCommitted does it
      }
      frames_->UpdateCommitted(job, frame_index);
    }
  }
  if (!was_blocked || !faulty.units.empty()) state_->health.AddFaulty(std::move(faulty));
}

void Audits::OnCommitted(const UnitIndex& unit) {
  const FrameState& frame = *state_->jobs.Get(unit.job).frames.Find(unit.place.frame);
  if (!frame.revoking.contains(unit.place.number)) return;
  const uint32_t deliverer = frame.deliverers[static_cast<size_t>(unit.place.number)];
  state_->health.AddFaulty(
      {.name = state_->deliverers.NameOf(deliverer), .reason = "", .units = {state_->jobs.RefOf(unit)}});
}

bool Audits::HasAuditor(const State& state, const UnitIndex& unit) {
  const Requirement& requirement = state.ready.RequirementOf(unit.job);
  int available = state.workers.Count(requirement).available;
  for (const std::string& name : state.audits.AskedOf(unit)) {
    for (const WorkerId id : state.workers.Named(name)) {
      const Worker& worker = *state.workers.Find(id);
      if (worker.IsAvailable() && requirement.Admits(state.workers.KindOf(worker.kind))) --available;
    }
  }
  return available > 0;
}

void Audits::Expire(absl::Time now) {
  for (const UnitIndex& unit : state_->audits.TakeDue(now)) {
    if (state_->audits.IsLeased(unit) || HasAuditor(*state_, unit)) {
      state_->audits.Extend(unit, now);
      continue;
    }
    state_->audits.Waive(unit);
    frames_->OnAuditEnded(state_->jobs.Get(unit.job), unit.place.frame);
  }
}

void Audits::End(const UnitIndex& unit) {
  if (state_->audits.End(unit)) frames_->OnAuditEnded(state_->jobs.Get(unit.job), unit.place.frame);
}

}  // namespace lumifold::scheduler
