#include "server/scheduler/second_leases.h"

#include <algorithm>
#include <iterator>

namespace lumifold::scheduler {

using job::Attempt;

namespace {

/// Accepted units of a kind from which their mean time is used: the first ones load the scene.
constexpr int64_t kMinTimedUnits = 8;

/// Late leases that are looked at for one worker.
constexpr int kMaxLateLooked = 64;

/// Units over which the speed of a worker is averaged: a machine gets other work to do, or a unit is unusual.
constexpr int kRatedUnits = 16;

/// Units of a worker that takes this many times the mean are late at once: a faster one may still overtake
/// it. With 1 every second lease is entered among the late ones, mostly for nothing; not tuned.
constexpr double kSlow = 1.2;

/// A lease is not late before this, however short the units of its job are: a second lease costs a message.
constexpr absl::Duration kLeastLate = absl::Milliseconds(200);

}  // namespace

SecondLeases::SecondLeases(const SchedulerOptions& options)
    : standstill_(options.lease),
      late_factor_(options.late_factor),
      overdue_factor_(options.overdue_factor),
      overdue_least_(options.overdue_least) {}

bool SecondLeases::CountTime(const Kind& kind, absl::Duration time) {
  UnitTimes& times = times_[kind.job][kind.size];
  times.sum += time;
  return ++times.count == kMinTimedUnits;
}

std::optional<absl::Duration> SecondLeases::MeanOf(const Kind& kind) const {
  const auto job = times_.find(kind.job);
  if (job == times_.end()) return std::nullopt;
  const UnitTimes& times = job->second[kind.size];
  return times.count < kMinTimedUnits ? std::nullopt : std::optional(times.sum / times.count);
}

void SecondLeases::Rate(absl::Duration time, absl::Duration mean, Worker* worker) {
  worker->rated = std::min(worker->rated + 1, kRatedUnits);
  worker->slowness += (absl::FDivDuration(time, mean) - worker->slowness) / worker->rated;
}

absl::Time SecondLeases::OverdueTime(const Kind& kind, absl::Time granted) const {
  const std::optional<absl::Duration> mean = MeanOf(kind);
  if (!mean.has_value()) return absl::InfiniteFuture();
  return granted + std::max(overdue_factor_ * *mean, overdue_least_);
}

absl::Time SecondLeases::LateTime(const Kind& kind, double slowness, const Lease& lease) const {
  const std::optional<absl::Duration> mean = MeanOf(kind);
  if (!mean.has_value()) return lease.progressed + standstill_;
  const absl::Duration late =
      std::max(slowness >= kSlow ? absl::ZeroDuration() : late_factor_ * *mean, kLeastLate);
  return std::min(lease.granted + late, OverdueTime(kind, lease.granted));
}

absl::Time SecondLeases::OnlyCheckOf(const Kind& kind, const Lease& lease) const {
  return MeanOf(kind).has_value() ? OverdueTime(kind, lease.granted) : lease.progressed + standstill_;
}

void SecondLeases::Schedule(const Kind& kind, double slowness, Lease* lease) const {
  if (lease->is_overdue) return;
  if (lease->alone || lease->audit) {
    lease->check = OnlyCheckOf(kind, *lease);
  } else {
    lease->check = lease->is_late ? OverdueTime(kind, lease->granted) : LateTime(kind, slowness, *lease);
  }
}

bool SecondLeases::MarkOnlyOverdue(const Kind& kind, absl::Time now, Lease* lease) const {
  if (lease->is_overdue) return false;
  lease->check = OnlyCheckOf(kind, *lease);  // the mean may have risen, or the unit advanced, since
  lease->is_overdue = lease->check <= now;
  if (lease->is_overdue) lease->check = absl::InfiniteFuture();
  return lease->is_overdue;
}

bool SecondLeases::MarkLate(const Kind& kind, double slowness, absl::Time now, Lease* lease) const {
  if (lease->is_late) return false;
  lease->check = LateTime(kind, slowness, *lease);  // the mean may have risen, or the unit advanced, since
  lease->is_late = lease->check <= now;
  if (!lease->is_late) return false;
  // A unit that takes long already is expected to take as long again, as long times are spread.
  const absl::Duration usual = slowness * MeanOf(kind).value_or(absl::ZeroDuration());
  lease->expected_end = lease->granted + std::max(usual, 2 * (now - lease->granted));
  lease->check = OverdueTime(kind, lease->granted);
  return true;
}

bool SecondLeases::MarkOverdue(const Kind& kind, absl::Time now, Lease* lease) const {
  if (!lease->is_late || lease->check > now) return false;
  lease->check = OverdueTime(kind, lease->granted);  // the mean may have risen since
  lease->is_overdue = lease->check <= now;
  if (lease->is_overdue) lease->check = absl::InfiniteFuture();
  return lease->is_overdue;
}

bool SecondLeases::IsWorthwhile(const Lease& late, const Kind& kind, double slowness, absl::Time now) const {
  const std::optional<absl::Duration> mean = MeanOf(kind);
  if (!mean.has_value()) return true;  // the lease stands still
  const absl::Duration expected = slowness * *mean;
  const absl::Duration held = now - late.granted;
  return now + expected < std::max(late.expected_end, now + held / 2);
}

void SecondLeases::Enter(const Requirement& requirement, absl::Time expected_end, Attempt attempt) {
  late_[requirement].emplace(expected_end, attempt);
}

void SecondLeases::Remove(const Requirement& requirement, absl::Time expected_end, Attempt attempt) {
  const auto late = late_.find(requirement);
  if (late == late_.end()) return;
  late->second.erase({expected_end, attempt});
  if (late->second.empty()) late_.erase(late);
}

bool SecondLeases::HasAny(const Requirement& worker_kind) const {
  return std::any_of(late_.begin(), late_.end(),
                     [&](const auto& entry) { return entry.first.Admits(worker_kind); });
}

std::optional<Attempt> SecondLeases::Take(const Requirement& worker_kind,
                                          absl::FunctionRef<Use(Attempt)> use) {
  for (auto late = late_.begin(); late != late_.end();) {
    auto& [requirement, leases] = *late;
    std::optional<Attempt> taken;
    auto it = requirement.Admits(worker_kind) ? leases.end() : leases.begin();
    for (int looked = 0; !taken.has_value() && it != leases.begin() && looked < kMaxLateLooked; ++looked) {
      --it;
      const Attempt attempt = it->second;
      const Use what = use(attempt);
      if (what == Use::kKeep) continue;
      it = leases.erase(it);
      if (what == Use::kTake) taken = attempt;
    }
    late = leases.empty() ? late_.erase(late) : std::next(late);
    if (taken.has_value()) return taken;
  }
  return std::nullopt;
}

}  // namespace lumifold::scheduler
