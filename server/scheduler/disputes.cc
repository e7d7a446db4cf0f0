#include "server/scheduler/disputes.h"

#include <limits>
#include <optional>

#include "absl/strings/str_cat.h"
#include "server/job/plan.h"

namespace lumifold::scheduler {

void Disputes::Judge(const UnitIndex& unit, absl::Time now) {
  const Evidence::Record* const record = state_->evidence.Find(unit);
  if (record == nullptr || record->Parties() == 0) return;
  const DisputeOptions& options = state_->options.disputes;
  if (record->Parties() >= options.deciding_parties ||
      state_->evidence.WitnessesOf(*record) >= options.deciding_witnesses)
    return Fail(unit, *record);
  state_->evidence.SetDue(unit, now + options.patience);
}

void Disputes::Expire(absl::Time now) {
  for (const UnitIndex& unit : state_->evidence.TakeDue(now)) {
    const Evidence::Record& record = *state_->evidence.Find(unit);
    if ((state_->evidence.WitnessesOf(record) >= 1 || record.Parties() >= 2) &&
        !CanAskAnother(*state_, unit)) {
      Fail(unit, record);
    } else if (record.Parties() > 0) {
      state_->evidence.SetDue(unit, now + state_->options.disputes.patience);
    }
  }
}

bool Disputes::CanAskAnother(const State& state, const UnitIndex& unit) {
  const Requirement& requirement = state.ready.RequirementOf(unit.job);
  for (const job::WorkerId id : state.workers.After(job::WorkerId(0), std::numeric_limits<int>::max())) {
    const Worker& worker = *state.workers.Find(id);
    if (!worker.IsAvailable() || !requirement.Admits(state.workers.KindOf(worker.kind))) continue;
    if (state.evidence.IsAskedAbout(unit, worker.traits.party)) return true;
  }
  return false;
}

void Disputes::Fail(const UnitIndex& unit, const Evidence::Record& record) {
  const Job& job = state_->jobs.Get(unit.job);
  const job::JobId& id = job.id;
  for (const FailedJob& failed : state_->failed) {
    if (failed.job == id) return;
  }
  std::optional<int32_t> frame;
  if (!job::NeedsPlan(job.units.spec())) frame = job.units.frames().NumberOf(unit.place.frame);
  state_->failed.push_back({id, record.last_error, frame});
}

}  // namespace lumifold::scheduler
