// Second leases of late units, where slots would be idle otherwise.
#include <algorithm>
#include <limits>

#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::WorkerId;

namespace {

/// Late leases that are looked at for one worker, and free workers for one call.
constexpr int kMaxLateLooked = 64;
constexpr size_t kMaxWorkersLooked = 64;

/// Units over which the speed of a worker is averaged: a machine gets other work to do, or a unit is unusual.
constexpr int kRatedUnits = 16;

/// Units of a worker that takes this many times the mean are late at once: a faster one may still overtake
/// it. With 1 every second lease is entered among the late ones, mostly for nothing; not tuned.
constexpr double kSlow = 1.2;

/// A lease is not late before this, however short the units of its job are: a second lease costs a message.
constexpr absl::Duration kLeastLate = absl::Milliseconds(200);

}  // namespace

void Scheduler::RateWorker(const Lease& lease, absl::Time now) {
  const std::optional<absl::Duration> mean = MeanTime(lease.unit);
  if (!mean.has_value() || *mean <= absl::ZeroDuration()) return;
  const double ratio = absl::FDivDuration(now - lease.granted, *mean);
  workers_.Change(lease.worker, [ratio](Worker& worker) {
    worker.rated = std::min(worker.rated + 1, kRatedUnits);
    worker.slowness += (ratio - worker.slowness) / worker.rated;
  });
}

absl::Time Scheduler::LateTime(const UnitIndex& index, WorkerId worker, absl::Time granted) const {
  const std::optional<absl::Duration> mean = MeanTime(index);
  if (!mean.has_value()) return absl::InfiniteFuture();
  const bool is_slow = workers_.Find(worker)->slowness >= kSlow;
  const absl::Duration late =
      std::max(is_slow ? absl::ZeroDuration() : options_.late_factor * *mean, kLeastLate);
  return std::min(granted + late, OverdueTime(index, granted));
}

void Scheduler::MarkLate(Attempt attempt, Lease lease, absl::Time now) {
  if (lease.is_late) return;
  lease.check = LateTime(lease.unit, lease.worker, lease.granted);  // the mean may have risen since
  lease.is_late = lease.check <= now;
  if (lease.is_late) {
    // A unit that takes long already is expected to take as long again, as long times are spread.
    const absl::Duration usual = workers_.Find(lease.worker)->slowness * *MeanTime(lease.unit);
    lease.expected_end = lease.granted + std::max(usual, 2 * (now - lease.granted));
    lease.check = OverdueTime(lease.unit, lease.granted);
    if (leases_.OfUnit(lease.unit).size() == 1)
      jobs_.at(lease.unit.job).demand->second.late.emplace(lease.expected_end, attempt);
  }
  leases_.Update(attempt, lease);
}

bool Scheduler::HasLate(const Requirement& kind) const {
  return std::any_of(demands_.begin(), demands_.end(), [&](const auto& entry) {
    return !entry.second.late.empty() && entry.first.Admits(kind);
  });
}

void Scheduler::Speculate(absl::Time now, std::vector<GrantedLease>* granted) {
  std::optional<int> kind = workers_.NextFreeKind(-1);
  for (; kind.has_value(); kind = workers_.NextFreeKind(*kind)) {
    const Requirement& requirement = workers_.KindOf(*kind);
    if (!HasLate(requirement)) continue;
    std::vector<std::pair<double, WorkerId>> free;  // the fastest first
    WorkerId last(std::numeric_limits<int64_t>::min());
    while (free.size() < kMaxWorkersLooked) {
      const std::optional<WorkerId> worker = workers_.NextFree(*kind, last);
      if (!worker.has_value()) break;
      last = *worker;
      free.emplace_back(workers_.Find(last)->slowness, last);
    }
    std::sort(free.begin(), free.end());
    for (const auto& [slowness, worker] : free) {
      std::optional<UnitIndex> unit;
      while (workers_.IsFree(worker) && (unit = TakeLateUnit(worker, requirement, now)).has_value())
        granted->push_back(Grant(*unit, worker, now, LeaseKind::kOrdinary));
      if (workers_.IsFree(worker)) break;  // slower ones will find nothing either
    }
  }
}

bool Scheduler::IsWorthASecondLease(const Lease& lease, WorkerId worker, absl::Time now) const {
  const Job& job = jobs_.at(lease.unit.job);
  const bool has_leases_left = job.max_leases == 0 || job.lease_count < job.max_leases;
  if (job.paused || !has_leases_left || job.returned.contains(lease.unit.place) || IsSuspect(lease.unit) ||
      IsExcluded(job, lease.unit, worker))
    return false;
  const absl::Duration expected = workers_.Find(worker)->slowness * *MeanTime(lease.unit);
  const absl::Duration held = now - lease.granted;
  return now + expected < std::max(lease.expected_end, now + held / 2);
}

std::optional<UnitIndex> Scheduler::TakeLateUnit(WorkerId worker, const Requirement& kind, absl::Time now) {
  for (auto& [requirement, demand] : demands_) {
    if (demand.late.empty() || !requirement.Admits(kind)) continue;
    auto it = demand.late.end();
    for (int looked = 0; it != demand.late.begin() && looked < kMaxLateLooked; ++looked) {
      --it;
      const Lease& lease = *leases_.Find(it->second);
      const UnitIndex unit = lease.unit;
      const bool has_second = leases_.OfUnit(unit).size() > 1;  // it was overdue and has been leased again
      if (!has_second && !IsWorthASecondLease(lease, worker, now)) continue;
      it = demand.late.erase(it);
      if (!has_second) return unit;
    }
  }
  return std::nullopt;
}

}  // namespace lumifold::scheduler
