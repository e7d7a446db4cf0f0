#include "server/coordinator/in_hand.h"

#include <utility>

namespace lumifold::server {
namespace {

using job::JobId;
using job::WorkerId;

/// Time for which units in hand of jobs that are not active here are remembered: a job of a coordinator that
/// was lost is claimed meanwhile. Workers drop such units no later than that.
constexpr absl::Duration kRememberInHand = absl::Seconds(60);

}  // namespace

void UnitsInHand::Add(WorkerId worker, const v1::Hello& hello, absl::Time now) {
  for (const v1::Lease& lease : hello.in_hand()) {
    const job::UnitRef unit = job::UnitFromProto(lease.unit());
    units_[unit.job].push_back({.worker = worker,
                                .unit = unit,
                                .attempt = job::Attempt(lease.attempt()),
                                .until = now + kRememberInHand});
  }
}

void UnitsInHand::Forget(absl::FunctionRef<bool(const UnitInHand&)> condition) {
  for (auto& [job, units] : units_) std::erase_if(units, condition);
  std::erase_if(units_, [](const auto& entry) { return entry.second.empty(); });
}

void UnitsInHand::ForgetWorker(WorkerId worker) {
  Forget([worker](const UnitInHand& unit) { return unit.worker == worker; });
}

void UnitsInHand::ForgetExpired(absl::Time now) {
  Forget([now](const UnitInHand& unit) { return unit.until <= now; });
}

std::map<WorkerId, std::vector<UnitInHand>> UnitsInHand::Take(absl::FunctionRef<bool(const JobId&)> has_job) {
  std::map<WorkerId, std::vector<UnitInHand>> by_worker;
  for (auto it = units_.begin(); it != units_.end();) {
    if (!has_job(it->first)) {
      ++it;
      continue;
    }
    for (UnitInHand& unit : it->second) by_worker[unit.worker].push_back(std::move(unit));
    it = units_.erase(it);
  }
  return by_worker;
}

std::vector<JobId> UnitsInHand::Jobs() const {
  std::vector<JobId> jobs;
  for (const auto& [job, units] : units_) jobs.push_back(job);
  return jobs;
}

std::set<WorkerId> UnitsInHand::WorkersWith(const JobId& job) const {
  std::set<WorkerId> workers;
  if (const auto units = units_.find(job); units != units_.end()) {
    for (const UnitInHand& unit : units->second) workers.insert(unit.worker);
  }
  return workers;
}

}  // namespace lumifold::server
