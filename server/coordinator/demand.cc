#include "server/coordinator/demand.h"

#include <algorithm>
#include <set>

namespace lumifold::server {

void DemandSum::Add(const v1::Scheduling& scheduling, const scheduler::JobProgress& progress) {
  if (progress.state == v1::JOB_STATE_PAUSED) return;  // also of jobs that wait for others
  const int64_t leased = progress.leases;
  // Late units are leased twice and audits are leases too: both can make leases exceed what is left.
  int64_t queued = std::max<int64_t>(0, progress.units_total - progress.units_done - leased);
  if (scheduling.max_leases() > 0)
    queued = std::min(queued, std::max<int64_t>(0, scheduling.max_leases() - leased));
  if (queued + leased == 0) return;
  const std::set<std::string> tags(scheduling.tags().begin(), scheduling.tags().end());
  v1::Demand& demand = by_user_[scheduling.user()][{tags.begin(), tags.end()}];
  demand.set_units_queued(demand.units_queued() + queued);
  demand.set_units_leased(demand.units_leased() + leased);
}

void DemandSum::AddTo(v1::ServerStatus* status) const {
  int user = 0;
  for (const auto& [name, by_tags] : by_user_) {
    for (const auto& [tags, demand] : by_tags) {
      v1::Demand* const added = status->add_demand();
      *added = demand;
      added->set_user(user);
      *added->mutable_tags() = {tags.begin(), tags.end()};
    }
    ++user;
  }
}

}  // namespace lumifold::server
