#include "server/scheduler/grants.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <set>
#include <string>
#include <utility>

namespace lumifold::scheduler {

using job::Attempt;
using job::WorkerId;

namespace {

/// Free units that a worker may not lease and that are passed over in one call, for each worker. It bounds
/// the time of a call; such a unit waits for another worker anyway.
constexpr int kMaxSkipped = 64;

/// Free workers that are looked at for late units in one call, of each kind.
constexpr size_t kMaxWorkersLooked = 64;

}  // namespace

Grants::Grants(State* state, Frames* frames, Leasing* leasing, Keeping* keeping)
    : state_(state), frames_(frames), leasing_(leasing), keeping_(keeping) {}

void Grants::Begin(absl::Time now) {
  state_->SetTime(now);
  state_->ready.FollowWorkers();
}

std::vector<GrantedLease> Grants::ToAll(absl::Time now) {
  Begin(now);
  std::vector<GrantedLease> granted;
  GrantQuarantined(now, &granted);
  const WorkerPool& workers = state_->workers;
  std::optional<int> kind = workers.NextFreeKind(-1);
  for (; kind.has_value(); kind = workers.NextFreeKind(*kind)) {
    WorkerId last(std::numeric_limits<int64_t>::min());
    while (state_->ready.HasAny(workers.KindOf(*kind))) {
      const std::optional<WorkerId> worker = workers.NextFree(*kind, last);
      if (!worker.has_value()) break;
      GrantTo(*worker, now, &granted);
      last = *worker;
    }
  }
  GrantSecond(now, &granted);
  return granted;
}

std::vector<GrantedLease> Grants::ToWorker(WorkerId worker, absl::Time now) {
  Begin(now);
  std::vector<GrantedLease> granted;
  GrantTo(worker, now, &granted);
  return granted;
}

void Grants::GrantTo(WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted) {
  const Worker* state = state_->workers.Find(worker);
  if (state == nullptr) return;
  SkipBudget budget = kMaxSkipped;
  std::set<int64_t> passed;  // jobs that have nothing for the worker
  while (state->IsFree() && budget > 0) {
    const std::optional<int64_t> number = state_->ready.Next(*state, passed, now);
    if (!number.has_value()) return;
    const std::optional<Taken> taken = TakeUnit(state_->jobs.Get(*number), worker, &budget);
    if (!taken.has_value()) {
      passed.insert(*number);
      continue;
    }
    const Leasing::Kind kind = taken->audit ? Leasing::Kind::kAudit : Leasing::Kind::kOrdinary;
    granted->push_back(leasing_->Grant({*number, taken->place}, worker, now, kind));
  }
}

std::optional<Grants::Taken> Grants::TakeUnit(Job& job, WorkerId worker, SkipBudget* budget) {
  if (const auto place = TakeReturnedUnit(job, worker, budget); place.has_value()) return Taken{*place};
  if (IsExcluded(job.number, *state_->workers.Find(worker))) return std::nullopt;
  const std::string& name = state_->workers.Find(worker)->traits.name;
  if (const auto place = state_->audits.Take(job.number, name); place.has_value())
    return Taken{*place, /*audit=*/true};
  if (const auto place = keeping_->TakeUnit(job, worker); place.has_value()) return Taken{*place};
  if (const auto place = TakeUnleasedUnit(job, worker); place.has_value()) return Taken{*place};
  return std::nullopt;
}

bool Grants::IsExcluded(int64_t job, const Worker& worker) const {
  return state_->evidence.IsExcluded(job, worker.traits.party, state_->latest);
}

bool Grants::MayLease(const UnitIndex& unit, WorkerId worker) const {
  for (const Attempt attempt : state_->leases.OfUnit(unit)) {
    if (state_->leases.Find(attempt)->worker == worker) return false;
  }
  const Worker& asked = *state_->workers.Find(worker);
  const bool may_ask = state_->evidence.FirstDispute(unit.job) == unit &&
                       state_->evidence.IsAskedAbout(unit, asked.traits.party);
  if (IsExcluded(unit.job, asked) && !may_ask) return false;
  return !state_->evidence.WasLastToFail(unit, state_->workers.Find(worker)->traits.name) ||
         !state_->workers.HasOther(worker, state_->ready.RequirementOf(unit.job));
}

std::optional<Place> Grants::TakeReturnedUnit(Job& job, WorkerId worker, SkipBudget* budget) {
  for (const Place& returned : job.free.returned()) {
    if (*budget <= 0) return std::nullopt;
    if (!MayLease({job.number, returned}, worker)) {
      --*budget;
      continue;
    }
    const Place place = returned;
    job.free.Withdraw(place);
    return place;
  }
  return std::nullopt;
}

std::optional<Place> Grants::TakeUnleasedUnit(Job& job, WorkerId worker) {
  const Place place = job.free.next();
  if (place.frame >= job.units.frames().count()) return std::nullopt;
  if (!job.frames.IsActive(place.frame)) {
    const Keeping::Next next = keeping_->NextOf(job, worker);
    if (next == Keeping::Next::kIsKept) return keeping_->Begin(job, worker);
    if (next == Keeping::Next::kWaits || !state_->ready.MayOpenFrame()) return std::nullopt;
  }
  frames_->Open(job, place.frame);
  job.free.TakeNext();
  return place;
}

void Grants::GrantQuarantined(absl::Time now, std::vector<GrantedLease>* granted) {
  state_->quarantine.Reserve(
      [this](const UnitIndex& unit) {
        const Job& job = state_->jobs.Get(unit.job);
        return job.paused ? nullptr : &state_->RequirementOf(job);
      },
      [this](const Worker& worker, const UnitIndex& unit) { return !IsExcluded(unit.job, worker); });
  for (const auto& [worker, unit] : state_->quarantine.TakeReady())
    granted->push_back(leasing_->Grant(unit, worker, now, Leasing::Kind::kAlone));
}

void Grants::GrantSecond(absl::Time now, std::vector<GrantedLease>* granted) {
  const WorkerPool& workers = state_->workers;
  std::optional<int> kind = workers.NextFreeKind(-1);
  for (; kind.has_value(); kind = workers.NextFreeKind(*kind)) {
    const Requirement& requirement = workers.KindOf(*kind);
    if (!state_->second_leases.HasAny(requirement)) continue;
    std::vector<std::pair<double, WorkerId>> free;  // the fastest first
    WorkerId last(std::numeric_limits<int64_t>::min());
    while (free.size() < kMaxWorkersLooked) {
      const std::optional<WorkerId> worker = workers.NextFree(*kind, last);
      if (!worker.has_value()) break;
      last = *worker;
      free.emplace_back(workers.Find(last)->slowness, last);
    }
    std::sort(free.begin(), free.end());
    for (const auto& [slowness, worker] : free) {
      std::optional<UnitIndex> unit;
      while (workers.IsFree(worker) && (unit = TakeLateUnit(worker, requirement, now)).has_value())
        granted->push_back(leasing_->Grant(*unit, worker, now, Leasing::Kind::kOrdinary));
      if (!state_->second_leases.HasAny(requirement)) break;
    }
  }
}

bool Grants::IsWorthASecondLease(const Lease& lease, WorkerId worker, absl::Time now) const {
  const Job& job = state_->jobs.Get(lease.unit.job);
  return !job.paused && !job.leases.IsFull() && !job.free.returned().contains(lease.unit.place) &&
         !state_->quarantine.IsSuspect(lease.unit) &&
         !state_->jobs.kept().Has({lease.unit.job, lease.unit.place.frame}) && MayLease(lease.unit, worker) &&
         state_->second_leases.IsWorthwhile(lease, state_->KindOf(lease.unit),
                                            state_->workers.Find(worker)->slowness, now);
}

std::optional<UnitIndex> Grants::TakeLateUnit(WorkerId worker, const Requirement& kind, absl::Time now) {
  const std::optional<Attempt> taken = state_->second_leases.Take(kind, [&](Attempt attempt) {
    const Lease& lease = *state_->leases.Find(attempt);
    // Otherwise it was overdue and has been leased again.
    const bool is_only = state_->leases.OfUnit(lease.unit).size() == 1;
    if (!is_only) return SecondLeases::Use::kDrop;
    return IsWorthASecondLease(lease, worker, now) ? SecondLeases::Use::kTake : SecondLeases::Use::kKeep;
  });
  return taken.has_value() ? std::optional(state_->leases.Find(*taken)->unit) : std::nullopt;
}

}  // namespace lumifold::scheduler
