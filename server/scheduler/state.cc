#include "server/scheduler/state.h"

namespace lumifold::scheduler {
namespace {

Readiness ReadinessOf(const Job& job, bool has_others) {
  if (job.paused || job.leases.IsFull()) return Readiness::kNone;
  if (!job.free.returned().empty() || has_others) return Readiness::kUnit;
  const int frame = job.free.next().frame;
  if (frame >= job.units.frames().count()) return Readiness::kNone;
  return job.frames.IsActive(frame) ? Readiness::kUnit : Readiness::kOpensFrame;
}

}  // namespace

State::State(const SchedulerOptions& scheduler_options)
    : options(scheduler_options),
      ready(options, &workers),
      second_leases(options),
      audits(options.audit_patience),
      quarantine(options.disputes.max_lost_workers, &workers),
      evidence(options),
      health(options, &workers),
      backoffs(options),
      accepted(options.uncommitted_bytes) {}

const Lease* State::FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const {
  const Lease* lease = leases.Find(attempt);
  return lease != nullptr && lease->worker == worker && lease->unit == jobs.IndexOf(unit) ? lease : nullptr;
}

SecondLeases::Kind State::KindOf(const UnitIndex& unit) const {
  return {.job = unit.job, .size = jobs.Get(unit.job).units.SizeOf(unit.place)};
}

void State::UpdateReady(Job& job) {
  job.free.Advance(job.units, job.frames);
  ready.Set(job.number, ReadinessOf(job, audits.HasReady(job.number) || jobs.kept().HasUnleased(job.number)),
            latest);
}

}  // namespace lumifold::scheduler
