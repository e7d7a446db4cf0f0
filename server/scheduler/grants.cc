// Which unit a free worker gets.
#include <algorithm>
#include <limits>

#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::FrameUnits;
using job::UnitRef;
using job::WorkerId;

namespace {

/// Free units that a worker may not lease and that are passed over in one call, for each worker. It bounds
/// the time of a call; such a unit waits for another worker anyway.
constexpr int kMaxSkipped = 64;

/// One of this many leases may go to the job that has waited longest, see SchedulerOptions::longest_wait:
/// with more waiting jobs than the farm can serve, the others must not get the order of a queue.
constexpr int64_t kGrantsPerWaiting = 8;

}  // namespace

std::vector<GrantedLease> Scheduler::GrantLeases(absl::Time now) {
  latest_ = std::max(latest_, now);
  if (counted_kinds_ != workers_.version()) RecountLiveFrames();
  std::vector<GrantedLease> granted;
  GrantQuarantined(now, &granted);
  std::optional<int> kind = workers_.NextFreeKind(-1);
  for (; kind.has_value(); kind = workers_.NextFreeKind(*kind)) {
    WorkerId last(std::numeric_limits<int64_t>::min());
    while (HasReady(workers_.KindOf(*kind))) {
      const std::optional<WorkerId> worker = workers_.NextFree(*kind, last);
      if (!worker.has_value()) break;
      GrantTo(*worker, now, &granted);
      last = *worker;
    }
  }
  Speculate(now, &granted);
  return granted;
}

std::vector<GrantedLease> Scheduler::GrantLeases(WorkerId worker, absl::Time now) {
  latest_ = std::max(latest_, now);
  if (counted_kinds_ != workers_.version()) RecountLiveFrames();
  std::vector<GrantedLease> granted;
  GrantTo(worker, now, &granted);
  return granted;
}

void Scheduler::GrantTo(WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted) {
  const Worker* state = workers_.Find(worker);
  if (state == nullptr) return;
  SkipBudget budget = kMaxSkipped;
  std::set<int64_t> passed;  // jobs that have nothing for the worker
  while (state->IsFree() && budget > 0) {
    const std::optional<int64_t> number = NextReady(*state, passed, now);
    if (!number.has_value()) return;
    const std::optional<Taken> taken = TakeUnit(*number, worker, &budget);
    if (!taken.has_value()) {
      passed.insert(*number);
      continue;
    }
    const LeaseKind kind = taken->audit ? LeaseKind::kAudit : LeaseKind::kOrdinary;
    granted->push_back(Grant({*number, taken->place}, worker, now, kind));
  }
}

std::optional<int64_t> Scheduler::NextReady(const Worker& worker, const std::set<int64_t>& passed,
                                            absl::Time now) {
  const Requirement& kind = workers_.KindOf(worker.kind);
  const auto last = jobs_.find(worker.last_job);
  std::optional<FairShare::Candidate> first;
  std::pair<absl::Time, int64_t> longest_waiting(absl::InfiniteFuture(), 0);
  bool may_stay = false;
  const auto look = [&](FairShare::Queue& queue) {
    if (queue.IsEmpty()) return;
    const std::optional<FairShare::Candidate> candidate = share_.First(queue, passed);
    if (candidate.has_value() && (!first.has_value() || *candidate < *first)) first = candidate;
    longest_waiting = std::min(longest_waiting, *FairShare::LongestWaiting(queue));
    may_stay = may_stay || (last != jobs_.end() && share_.QueueOf(last->first) == &queue);
  };
  for (auto& [requirement, demand] : demands_) {
    if (!requirement.Admits(kind)) continue;
    look(demand.with_unit);
    if (MayOpenFrame()) look(demand.opening_frame);
  }
  if (!first.has_value()) return std::nullopt;
  if (grants_ % kGrantsPerWaiting == 0 && longest_waiting.first + options_.longest_wait <= now &&
      !passed.contains(longest_waiting.second))
    return longest_waiting.second;
  if (may_stay && last->first != first->job && !passed.contains(last->first) &&
      share_.IsNear(last->first, *first, options_.locality))
    return last->first;
  share_.Choose(*first);
  return first->job;
}

Scheduler::Readiness Scheduler::ReadinessOf(const Job& job) {
  if (job.paused || (job.max_leases > 0 && job.lease_count >= job.max_leases)) return Readiness::kNone;
  if (!job.returned.empty() || !job.audits_ready.empty()) return Readiness::kUnit;
  if (job.next_unleased.frame >= job.frame_list.count()) return Readiness::kNone;
  return job.frames.contains(job.next_unleased.frame) ? Readiness::kUnit : Readiness::kOpensFrame;
}

void Scheduler::UpdateReady(int64_t number, Job& job) {
  Advance(job);
  job.ahead.erase(job.ahead.begin(), job.ahead.lower_bound(job.next_unleased));
  SetReadiness(number, job, ReadinessOf(job));
}

void Scheduler::SetReadiness(int64_t number, Job& job, Readiness readiness) {
  if (job.readiness == readiness) return;
  job.readiness = readiness;
  Demand& demand = job.demand->second;
  FairShare::Queue* queue = nullptr;
  if (readiness == Readiness::kUnit) queue = &demand.with_unit;
  if (readiness == Readiness::kOpensFrame) queue = &demand.opening_frame;
  share_.SetQueue(number, queue, latest_);
}

bool Scheduler::HasReady(const Requirement& kind) const {
  const bool may_open = MayOpenFrame();
  return std::any_of(demands_.begin(), demands_.end(), [&](const auto& entry) {
    const Demand& demand = entry.second;
    return (!demand.with_unit.IsEmpty() || (may_open && !demand.opening_frame.IsEmpty())) &&
           entry.first.Admits(kind);
  });
}

std::optional<Scheduler::Taken> Scheduler::TakeUnit(int64_t job_number, WorkerId worker, SkipBudget* budget) {
  if (const auto place = TakeReturnedUnit(job_number, worker, budget); place.has_value())
    return Taken{*place};
  if (const auto place = TakeAudit(jobs_.at(job_number), worker); place.has_value())
    return Taken{*place, /*audit=*/true};
  if (const auto place = TakeUnleasedUnit(job_number); place.has_value()) return Taken{*place};
  return std::nullopt;
}

bool Scheduler::IsExcluded(const Job& job, const UnitIndex& index, WorkerId worker) const {
  for (const Attempt attempt : leases_.OfUnit(index)) {
    if (leases_.Find(attempt)->worker == worker) return true;
  }
  const auto history = job.history.find(index.place);
  return history != job.history.end() && history->second.last_failed == workers_.Find(worker)->traits.name &&
         workers_.HasOther(worker, RequirementOf(job));
}

std::optional<Place> Scheduler::TakeReturnedUnit(int64_t job_number, WorkerId worker, SkipBudget* budget) {
  Job& job = jobs_.at(job_number);
  for (auto it = job.returned.begin(); it != job.returned.end() && *budget > 0; ++it) {
    if (IsExcluded(job, {job_number, *it}, worker)) {
      --*budget;
      continue;
    }
    const Place place = *it;
    job.returned.erase(it);
    return place;
  }
  return std::nullopt;
}

void Scheduler::Advance(Job& job) {
  Place& next = job.next_unleased;
  for (; next.frame < job.frame_list.count(); next = {next.frame + 1, 0}) {
    if (job.finished[static_cast<size_t>(next.frame)]) continue;
    const auto frame = job.frames.find(next.frame);
    if (frame == job.frames.end()) return;
    while (next.number < job.ordered_units() &&
           (frame->second.taken[static_cast<size_t>(next.number)] || job.ahead.contains(next)))
      ++next.number;
    if (next.number < job.ordered_units()) return;
  }
}

std::optional<Place> Scheduler::TakeUnleasedUnit(int64_t job_number) {
  Job& job = jobs_.at(job_number);
  const Place place = job.next_unleased;
  if (place.frame >= job.frame_list.count()) return std::nullopt;
  if (!job.frames.contains(place.frame) && !MayOpenFrame()) return std::nullopt;
  ActiveFrame(job, place.frame);
  ++job.next_unleased.number;
  return place;
}

std::vector<GrantedLease> Scheduler::Regrant(WorkerId worker, absl::Span<const UnitRef> units,
                                             absl::Time now) {
  latest_ = std::max(latest_, now);
  if (counted_kinds_ != workers_.version()) RecountLiveFrames();
  std::vector<GrantedLease> granted;
  for (const UnitRef& unit : units) {
    const std::optional<UnitIndex> index = IndexOf(unit);
    if (index.has_value() && workers_.IsFree(worker) && TakeInHand(*index, worker))
      granted.push_back(Grant(*index, worker, now, LeaseKind::kOrdinary));
  }
  return granted;
}

bool Scheduler::TakeInHand(const UnitIndex& index, WorkerId worker) {
  Job& job = jobs_.at(index.job);
  const Place& place = index.place;
  const bool has_leases_left = job.max_leases == 0 || job.lease_count < job.max_leases;
  if (job.paused || !has_leases_left || HasResult(RefOf(index)) || IsSuspect(index) ||
      job.delayed.contains(place) || !RequirementOf(job).Admits(workers_.KindOf(workers_.Find(worker)->kind)))
    return false;
  const std::vector<Attempt> attempts = leases_.OfUnit(index);
  const auto is_second = [&](Attempt attempt) {
    const Lease& lease = *leases_.Find(attempt);
    return lease.worker != worker && !lease.alone;
  };
  if (!attempts.empty()) {
    if (attempts.size() >= kMaxLeasesOfUnit || !std::all_of(attempts.begin(), attempts.end(), is_second))
      return false;
    job.returned.erase(place);  // it is overdue
    return true;
  }
  if (job.returned.erase(place) > 0) return true;
  if (place < job.next_unleased || place.number >= job.ordered_units()) return false;
  if (!job.frames.contains(place.frame) && !MayOpenFrame()) return false;
  ActiveFrame(job, place.frame);
  job.ahead.insert(place);
  return true;
}

GrantedLease Scheduler::Grant(const UnitIndex& index, WorkerId worker, absl::Time now, LeaseKind kind) {
  const Attempt attempt(next_attempt_++);
  ++grants_;
  leases_.Add(attempt,
              {.unit = index,
               .worker = worker,
               .granted = now,
               .deadline = now + std::min(options_.lease, options_.stall),
               .progressed = now,
               .check = kind == LeaseKind::kOrdinary ? LateTime(index, worker, now) : absl::InfiniteFuture(),
               .alone = kind == LeaseKind::kAlone,
               .audit = kind == LeaseKind::kAudit});
  share_.Granted(index.job, now);
  workers_.Change(worker, [&](Worker& state) {
    ++state.busy;
    state.last_job = index.job;
  });
  Job& job = jobs_.at(index.job);
  ++job.lease_count;
  if (kind != LeaseKind::kAudit && leases_.OfUnit(index).size() == 1) ++job.leased_units;
  ++job.holders[worker];
  UpdateReady(index.job, job);
  const UnitRef unit = RefOf(index);
  return {.worker = worker,
          .unit = unit,
          .attempt = attempt,
          .rect = job.units.tiles().RectOf(unit.key.tile),
          .samples = SamplesOf(job, index.place),
          .alone = kind == LeaseKind::kAlone,
          .audit = kind == LeaseKind::kAudit};
}

}  // namespace lumifold::scheduler
