#include "server/scheduler/lease_table.h"

#include <algorithm>
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
  Move(attempt, absl::InfiniteFuture(), lease.check, &by_check_);
}

void LeaseTable::Move(Attempt attempt, absl::Time from, absl::Time to, Times* times) {
  if (from == to) return;
  if (from < absl::InfiniteFuture()) times->erase({from, attempt});
  if (to < absl::InfiniteFuture()) times->emplace(to, attempt);
}

const Lease* LeaseTable::Find(Attempt attempt) const {
  const auto found = by_attempt_.find(attempt);
  return found == by_attempt_.end() ? nullptr : &found->second;
}

void LeaseTable::Update(Attempt attempt, const Lease& lease) {
  Lease& old = by_attempt_.at(attempt);
  LUMIFOLD_CHECK(old.unit == lease.unit && old.worker == lease.worker);
  Move(attempt, old.deadline, lease.deadline, &by_deadline_);
  Move(attempt, old.check, lease.check, &by_check_);
  old = lease;
}

Lease LeaseTable::Remove(Attempt attempt) {
  const auto found = by_attempt_.find(attempt);
  LUMIFOLD_CHECK(found != by_attempt_.end());
  const Lease lease = found->second;
  by_unit_.erase({lease.unit, attempt});
  by_worker_.erase({lease.worker, attempt});
  by_deadline_.erase({lease.deadline, attempt});
  Move(attempt, lease.check, absl::InfiniteFuture(), &by_check_);
  by_attempt_.erase(found);
  return lease;
}

std::vector<Attempt> LeaseTable::OfUnit(const UnitIndex& unit) const {
  std::vector<Attempt> attempts;
  for (auto it = by_unit_.lower_bound({unit, kFirst}); it != by_unit_.end() && it->first == unit; ++it)
    attempts.push_back(it->second);
  return attempts;
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

std::vector<Attempt> LeaseTable::NotAfter(absl::Time now, const Times& times) {
  std::vector<Attempt> attempts;
  for (auto it = times.begin(); it != times.end() && it->first <= now; ++it) attempts.push_back(it->second);
  return attempts;
}

std::vector<Attempt> LeaseTable::Expired(absl::Time now) const { return NotAfter(now, by_deadline_); }

std::vector<Attempt> LeaseTable::Checks(absl::Time now) const { return NotAfter(now, by_check_); }

absl::Time LeaseTable::NextTime() const {
  absl::Time next = absl::InfiniteFuture();
  if (!by_deadline_.empty()) next = by_deadline_.begin()->first;
  if (!by_check_.empty()) next = std::min(next, by_check_.begin()->first);
  return next;
}

}  // namespace lumifold::scheduler
