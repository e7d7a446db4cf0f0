#include "server/scheduler/accepted_units.h"

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::WorkerId;

bool AcceptedUnits::Add(const UnitIndex& unit, WorkerId worker, uint64_t bytes) {
  bytes_ += bytes;
  const bool is_free = bytes_ <= max_bytes_;
  const bool is_new =
      units_.emplace(unit, Accepted{is_free ? std::nullopt : std::optional(worker), bytes}).second;
  LUMIFOLD_CHECK(is_new);
  return is_free;
}

std::optional<WorkerId> AcceptedUnits::Remove(const UnitIndex& unit) {
  const auto accepted = units_.extract(unit);
  LUMIFOLD_CHECK(!accepted.empty());
  bytes_ -= accepted.mapped().bytes;
  return accepted.mapped().worker;
}

std::vector<UnitIndex> AcceptedUnits::OfJob(int64_t job) const {
  std::vector<UnitIndex> units;
  for (auto it = units_.lower_bound({job, {}}); it != units_.end() && it->first.job == job; ++it)
    units.push_back(it->first);
  return units;
}

}  // namespace lumifold::scheduler
