#include "server/scheduler/lease_table.h"

#include <limits>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::WorkerId;

namespace {

const Attempt kFirst(std::numeric_limits<int64_t>::min());

}  // namespace

void LeaseTable::Add(Attempt attempt, const Lease& lease) {
  LUMIFOLD_CHECK(by_attempt_.emplace(attempt, lease).second);
  by_unit_.emplace(lease.unit, attempt);
  by_worker_.emplace(lease.worker, attempt);
  by_deadline_.emplace(lease.deadline, attempt);
}

const Lease* LeaseTable::Find(Attempt attempt) const {
  const auto found = by_attempt_.find(attempt);
  return found == by_attempt_.end() ? nullptr : &found->second;
}

void LeaseTable::SetDeadline(Attempt attempt, absl::Time deadline) {
  Lease& lease = by_attempt_.at(attempt);
  by_deadline_.erase({lease.deadline, attempt});
  lease.deadline = deadline;
  by_deadline_.emplace(deadline, attempt);
}

Lease LeaseTable::Remove(Attempt attempt) {
  const auto found = by_attempt_.find(attempt);
  LUMIFOLD_CHECK(found != by_attempt_.end());
  const Lease lease = found->second;
  by_unit_.erase({lease.unit, attempt});
  by_worker_.erase({lease.worker, attempt});
  by_deadline_.erase({lease.deadline, attempt});
  by_attempt_.erase(found);
  return lease;
}

std::vector<Attempt> LeaseTable::OfJob(int64_t job) const {
  std::vector<Attempt> attempts;
  for (auto it = by_unit_.lower_bound({{job, {}}, kFirst}); it != by_unit_.end() && it->first.job == job;
       ++it)
    attempts.push_back(it->second);
  return attempts;
}

std::vector<Attempt> LeaseTable::OfWorker(WorkerId worker) const {
  std::vector<Attempt> attempts;
  for (auto it = by_worker_.lower_bound({worker, kFirst}); it != by_worker_.end() && it->first == worker;
       ++it)
    attempts.push_back(it->second);
  return attempts;
}

std::vector<Attempt> LeaseTable::Expired(absl::Time now) const {
  std::vector<Attempt> attempts;
  for (auto it = by_deadline_.begin(); it != by_deadline_.end() && it->first <= now; ++it)
    attempts.push_back(it->second);
  return attempts;
}

absl::Time LeaseTable::NextDeadline() const {
  return by_deadline_.empty() ? absl::InfiniteFuture() : by_deadline_.begin()->first;
}

}  // namespace lumifold::scheduler
