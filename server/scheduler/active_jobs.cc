#include "server/scheduler/active_jobs.h"

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::JobId;
using job::UnitRef;

Job& ActiveJobs::Add(const JobId& id, const v1::JobSpec& spec, const JobOptions& options) {
  const int64_t number = next_++;
  LUMIFOLD_CHECK(numbers_.emplace(id, number).second);
  return jobs_.emplace(number, Job(number, id, spec, options)).first->second;
}

void ActiveJobs::Remove(int64_t number) {
  const auto job = jobs_.find(number);
  numbers_.erase(job->second.id);
  jobs_.erase(job);
}

Job* ActiveJobs::Find(const JobId& id) {
  const auto found = numbers_.find(id);
  return found == numbers_.end() ? nullptr : &jobs_.at(found->second);
}

const Job* ActiveJobs::Find(const JobId& id) const {
  const auto found = numbers_.find(id);
  return found == numbers_.end() ? nullptr : &jobs_.at(found->second);
}

std::optional<UnitIndex> ActiveJobs::IndexOf(const UnitRef& unit) const {
  const Job* job = Find(unit.job);
  if (job == nullptr) return std::nullopt;
  const std::optional<Place> place = job->units.PlaceOf(unit.key);
  if (!place.has_value()) return std::nullopt;
  return UnitIndex{job->number, *place};
}

UnitRef ActiveJobs::RefOf(const UnitIndex& unit) const {
  const Job& job = jobs_.at(unit.job);
  return {job.id, job.units.KeyOf(unit.place)};
}

}  // namespace lumifold::scheduler
