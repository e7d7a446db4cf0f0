#include "server/scheduler/scheduler.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::FrameUnits;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

namespace {

/// Free units that a worker may not lease and that are passed over in one call, for each worker. It bounds
/// the time of a call; such a unit waits for another worker anyway.
constexpr int kMaxSkipped = 64;

/// Accepted units of a job and kind from which their mean time is used: the first ones load the scene.
constexpr int kMinTimedUnits = 8;

/// A second lease is for a worker that hangs or is slow; a third would only cost.
constexpr size_t kMaxLeasesOfUnit = 2;

const Attempt kFirstAttempt(std::numeric_limits<int64_t>::min());

}  // namespace

Scheduler::Scheduler(const SchedulerOptions& options)
    : options_(options), next_attempt_(options.first_attempt.value()) {}

void Scheduler::AddJob(const JobId& job, const v1::JobSpec& spec, const std::string& numeric_class) {
  LUMIFOLD_CHECK(!HasJob(job));
  const int64_t number = next_job_++;
  jobs_by_id_.emplace(job, number);
  const auto added =
      jobs_.emplace(number, Job{.id = job,
                                .spec = spec,
                                .units = FrameUnits(spec),
                                .numeric_class = numeric_class,
                                .frames = {},
                                .finished = std::vector<bool>(static_cast<size_t>(spec.frame_count())),
                                .next_unleased = {},
                                .returned = {},
                                .geometry_times = {},
                                .pass_times = {},
                                .history = {}});
  UpdateReady(number, added.first->second);
}

bool Scheduler::RestoreCommittedUnit(const UnitRef& unit) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return false;
  Job& job = jobs_.at(index->job);
  if (job.finished[static_cast<size_t>(index->place.frame)]) return true;  // counted with its frame
  Frame& frame = ActiveFrame(job, index->place.frame);
  const auto number = static_cast<size_t>(index->place.number);
  if (frame.taken[number]) return true;
  frame.taken[number] = true;
  CountCommitted(job, index->place);
  return true;
}

bool Scheduler::RestoreFinishedFrame(const JobId& id, int32_t frame_number) {
  Job* job = FindJob(id);
  if (job == nullptr) return false;
  const int64_t frame = int64_t{frame_number} - job->spec.first_frame();
  if (frame < 0 || frame >= job->spec.frame_count()) return false;
  LUMIFOLD_CHECK(!job->frames.contains(static_cast<int>(frame)));  // finished frames are restored first
  if (job->finished[static_cast<size_t>(frame)]) return true;
  job->finished[static_cast<size_t>(frame)] = true;
  ++job->finished_count;
  job->committed_units += job->units.count();
  job->committed_samples += int64_t{job->spec.width()} * job->spec.height() * job->spec.samples_per_pixel();
  return true;
}

void Scheduler::EndJob(const JobId& id) {
  const auto found = jobs_by_id_.find(id);
  if (found == jobs_by_id_.end()) return;
  const int64_t number = found->second;
  for (const Attempt attempt : leases_.OfJob(number)) ReleaseSlot(leases_.Remove(attempt).worker);
  for (auto it = accepted_.lower_bound({number, {}}); it != accepted_.end() && it->first.job == number;) {
    ReleaseSlot(it->second);
    it = accepted_.erase(it);
  }
  std::vector<UnitIndex> quarantined(quarantine_.lower_bound({number, {}}),
                                     quarantine_.lower_bound({number + 1, {}}));
  for (const auto& [worker, reservation] : reservations_) {
    if (reservation.unit.job == number) quarantined.push_back(reservation.unit);
  }
  for (const UnitIndex& index : quarantined) RemoveFromQuarantine(index);
  RemoveReady(number, jobs_.at(number));
  jobs_.erase(number);
  jobs_by_id_.erase(found);
}

void Scheduler::AddWorker(WorkerId worker, const std::string& numeric_class, int slots,
                          const std::string& name) {
  workers_.Add(worker, name.empty() ? absl::StrCat("w-", worker.value()) : name, numeric_class, slots);
}

std::vector<FailedJob> Scheduler::RemoveWorker(WorkerId worker) {
  std::vector<FailedJob> failed;
  CancelReservation(worker);
  for (const Attempt attempt : leases_.OfWorker(worker)) {
    const Lease lease = *leases_.Find(attempt);
    std::string error = CountLoss(lease);
    if (!error.empty()) failed.push_back({jobs_.at(lease.unit.job).id, std::move(error)});
    VoidLease(attempt);
  }
  stalled_.erase(stalled_.lower_bound({worker, kFirstAttempt}),
                 stalled_.lower_bound({WorkerId(worker.value() + 1), kFirstAttempt}));
  reservations_.erase(worker);
  workers_.Remove(worker);
  return failed;
}

void Scheduler::Heartbeat(WorkerId worker, absl::Span<const HeldLease> held, Attempt newest, absl::Time now) {
  workers_.SetUnresponsive(worker, false);
  std::map<Attempt, int64_t> progress;
  for (const HeldLease& lease : held) progress.emplace(lease.attempt, lease.progress);
  for (const Attempt attempt : leases_.OfWorker(worker)) {
    const auto named = progress.find(attempt);
    if (named != progress.end()) {
      Renew(attempt, named->second, now);
    } else if (attempt <= newest) {
      VoidLease(attempt);
    }
  }
  for (auto it = stalled_.lower_bound({worker, kFirstAttempt});
       it != stalled_.end() && it->first == worker && it->second <= newest;) {
    if (progress.contains(it->second)) {
      ++it;
      continue;
    }
    ReleaseSlot(worker);
    it = stalled_.erase(it);
  }
}

void Scheduler::Renew(Attempt attempt, int64_t progress, absl::Time now) {
  Lease lease = *leases_.Find(attempt);
  if (progress != lease.progress) lease.progressed = now;
  lease.progress = progress;
  lease.deadline = std::min(now + options_.lease, lease.progressed + options_.stall);
  leases_.Update(attempt, lease);
}

std::vector<LateLease> Scheduler::ExpireLeases(absl::Time now) {
  ReturnDelayed(now);
  Readmit(now);
  std::vector<LateLease> late;
  for (const Attempt attempt : leases_.Expired(now)) {
    const Lease lease = *leases_.Find(attempt);
    const bool stalled = lease.deadline >= lease.progressed + options_.stall;
    late.push_back({RefOf(lease.unit), lease.worker, stalled ? Lateness::kStalled : Lateness::kSilent,
                    CountLoss(lease)});
    if (stalled) {
      workers_.TakeSlot(lease.worker);
      stalled_.emplace(lease.worker, attempt);
    } else {
      CancelReservation(lease.worker);
      workers_.SetUnresponsive(lease.worker, true);
    }
    VoidLease(attempt);
  }
  for (const Attempt attempt : leases_.Checks(now)) {
    Lease lease = *leases_.Find(attempt);
    lease.check = OverdueTime(lease.unit, lease.granted);  // the mean may have risen since
    lease.is_overdue = lease.check <= now;
    if (lease.is_overdue) lease.check = absl::InfiniteFuture();
    leases_.Update(attempt, lease);
    if (!lease.is_overdue || !MayReturn(lease.unit)) continue;
    Return(lease.unit);
    late.push_back({RefOf(lease.unit), lease.worker, Lateness::kOverdue, ""});
  }
  return late;
}

absl::Time Scheduler::NextExpiry() const {
  const absl::Time next = std::min(leases_.NextTime(), workers_.NextReadmission());
  return delayed_.empty() ? next : std::min(next, delayed_.begin()->first);
}

std::vector<GrantedLease> Scheduler::GrantLeases(absl::Time now) {
  std::vector<GrantedLease> granted;
  GrantQuarantined(now, &granted);
  std::optional<std::string> numeric_class = workers_.NextFreeClass("");
  for (; numeric_class.has_value(); numeric_class = workers_.NextFreeClass(*numeric_class)) {
    WorkerId last(std::numeric_limits<int64_t>::min());
    while (HasReady(*numeric_class)) {
      const std::optional<WorkerId> worker = workers_.NextFree(*numeric_class, last);
      if (!worker.has_value()) break;
      GrantTo(*worker, now, &granted);
      last = *worker;
    }
  }
  return granted;
}

std::vector<GrantedLease> Scheduler::GrantLeases(WorkerId worker, absl::Time now) {
  std::vector<GrantedLease> granted;
  GrantTo(worker, now, &granted);
  return granted;
}

void Scheduler::GrantTo(WorkerId worker, absl::Time now, std::vector<GrantedLease>* granted) {
  const Worker* state = workers_.Find(worker);
  if (state == nullptr) return;
  SkipBudget budget = kMaxSkipped;
  int64_t passed = -1;  // jobs up to this one have nothing for the worker
  while (workers_.IsFree(worker) && budget > 0) {
    const std::optional<int64_t> number = NextReady(state->numeric_class, passed);
    if (!number.has_value()) return;
    Job& job = jobs_.at(*number);
    const std::optional<Place> place = TakeUnit(*number, worker, &budget);
    UpdateReady(*number, job);
    if (!place.has_value()) {
      passed = *number;
      continue;
    }
    granted->push_back(Grant({*number, *place}, worker, now, /*alone=*/false));
  }
}

const Lease* Scheduler::FindLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  const Lease* lease = leases_.Find(attempt);
  return lease != nullptr && lease->worker == worker && lease->unit == IndexOf(unit) ? lease : nullptr;
}

bool Scheduler::HoldsLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  return FindLease(worker, unit, attempt) != nullptr;
}

Completion Scheduler::CompleteUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, absl::Time now) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return Completion::kUnknown;
  Job& job = jobs_.at(index->job);
  const auto frame = job.frames.find(index->place.frame);
  const bool finished = job.finished[static_cast<size_t>(index->place.frame)];
  if (finished ||
      (frame != job.frames.end() && frame->second.taken[static_cast<size_t>(index->place.number)])) {
    return Completion::kDuplicate;
  }
  if (!HoldsLease(worker, unit, attempt)) return Completion::kStale;
  CountTime(leases_.Remove(attempt), now);
  BlameOthers(*index, worker, now);
  VoidOtherLeases(*index);
  if (job.numeric_class.empty()) Bind(index->job, workers_.Find(worker)->numeric_class);
  accepted_.emplace(*index, worker);
  frame->second.taken[static_cast<size_t>(index->place.number)] = true;
  return Completion::kAccepted;
}

void Scheduler::VoidOtherLeases(const UnitIndex& index) {
  for (const Attempt attempt : leases_.OfUnit(index)) VoidLease(attempt);
  Job& job = jobs_.at(index.job);
  job.returned.erase(index.place);
  UpdateReady(index.job, job);
  if (job.history.contains(index.place)) RemoveFromQuarantine(index);
  job.history.erase(index.place);
}

Scheduler::UnitTimes& Scheduler::TimesOf(Job& job, const Place& place) const {
  const bool is_geometry = job.units.KeyOf(0, place.number).kind == v1::UNIT_KIND_GEOMETRY;
  return is_geometry ? job.geometry_times : job.pass_times;
}

void Scheduler::CountTime(const Lease& lease, absl::Time now) {
  Job& job = jobs_.at(lease.unit.job);
  UnitTimes& times = TimesOf(job, lease.unit.place);
  ++times.count;
  times.sum += now - lease.granted;
  if (times.count != kMinTimedUnits) return;
  for (const Attempt attempt : leases_.OfJob(lease.unit.job)) {
    Lease other = *leases_.Find(attempt);
    if (other.alone || other.is_overdue) continue;
    other.check = OverdueTime(other.unit, other.granted);
    leases_.Update(attempt, other);
  }
}

absl::Time Scheduler::OverdueTime(const UnitIndex& index, absl::Time granted) {
  const UnitTimes& times = TimesOf(jobs_.at(index.job), index.place);
  if (times.count < kMinTimedUnits) return absl::InfiniteFuture();
  const absl::Duration mean = times.sum / times.count;
  return granted + std::max(options_.overdue_factor * mean, options_.overdue_least);
}

void Scheduler::Bind(int64_t number, const std::string& numeric_class) {
  Job& job = jobs_.at(number);
  RemoveReady(number, job);
  job.numeric_class = numeric_class;
  UpdateReady(number, job);
  for (const Attempt attempt : leases_.OfJob(number)) {
    if (workers_.Find(leases_.Find(attempt)->worker)->numeric_class != numeric_class) VoidLease(attempt);
  }
}

bool Scheduler::UnitCommitted(const UnitRef& unit) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return false;  // the job ended while the unit was being committed
  const auto accepted = accepted_.find(*index);
  LUMIFOLD_CHECK(accepted != accepted_.end());
  ReleaseSlot(accepted->second);  // the worker may have disconnected since
  accepted_.erase(accepted);
  Job& job = jobs_.at(index->job);
  CountCommitted(job, index->place);
  return job.frames.at(index->place.frame).committed == job.units.count();
}

bool Scheduler::RevokeUnit(const UnitRef& unit) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value() || accepted_.contains(*index)) return false;
  Job& job = jobs_.at(index->job);
  const Place& place = index->place;
  const auto frame = job.frames.find(place.frame);  // a finished frame has none
  if (frame == job.frames.end() || !frame->second.taken[static_cast<size_t>(place.number)]) return false;
  frame->second.taken[static_cast<size_t>(place.number)] = false;
  --frame->second.committed;
  --job.committed_units;
  job.committed_samples -= job.units.CameraSamplesOf(unit.key);
  if (place < job.next_unleased) job.returned.insert(place);  // otherwise it is leased in its turn
  UpdateReady(index->job, job);
  return true;
}

std::vector<int32_t> Scheduler::CommittedFrames(const JobId& id) const {
  const Job& job = GetJob(id);
  std::vector<int32_t> frames;
  for (const auto& [frame, state] : job.frames) {
    if (state.committed == job.units.count()) frames.push_back(job.spec.first_frame() + frame);
  }
  return frames;
}

bool Scheduler::FrameFinished(const JobId& id, int32_t frame_number) {
  Job* job = FindJob(id);
  if (job == nullptr) return false;
  const int frame = frame_number - job->spec.first_frame();
  LUMIFOLD_CHECK(job->frames.at(frame).committed == job->units.count());
  job->frames.erase(frame);
  job->finished[static_cast<size_t>(frame)] = true;
  ++job->finished_count;
  return job->finished_count == job->spec.frame_count();
}

JobProgress Scheduler::Progress(const JobId& id) const {
  const Job& job = GetJob(id);
  JobProgress progress;
  progress.units_done = job.committed_units;
  progress.units_total = job.units.count() * job.spec.frame_count();
  progress.samples_done = job.committed_samples;
  progress.samples_total =
      int64_t{job.spec.width()} * job.spec.height() * job.spec.samples_per_pixel() * job.spec.frame_count();
  progress.frames_done = job.finished_count;
  progress.frames_total = job.spec.frame_count();
  std::set<WorkerId> holders;
  for (const Attempt attempt : leases_.OfJob(jobs_by_id_.at(id))) {
    holders.insert(leases_.Find(attempt)->worker);
  }
  progress.workers = static_cast<int>(holders.size());
  if (job.finished_count == job.spec.frame_count()) {
    progress.state = v1::JOB_STATE_DONE;
  } else if (!CommittedFrames(id).empty()) {
    progress.state = v1::JOB_STATE_FILTERING;
  } else {
    const bool started = !job.numeric_class.empty() || !holders.empty();
    progress.state = started ? v1::JOB_STATE_RENDERING : v1::JOB_STATE_QUEUED;
  }
  return progress;
}

const std::string& Scheduler::NumericClassOf(const JobId& id) const { return GetJob(id).numeric_class; }
const v1::JobSpec& Scheduler::SpecOf(const JobId& id) const { return GetJob(id).spec; }
const FrameUnits& Scheduler::UnitsOf(const JobId& id) const { return GetJob(id).units; }

Scheduler::Job* Scheduler::FindJob(const JobId& id) {
  const auto found = jobs_by_id_.find(id);
  return found == jobs_by_id_.end() ? nullptr : &jobs_.at(found->second);
}

const Scheduler::Job& Scheduler::GetJob(const JobId& id) const { return jobs_.at(jobs_by_id_.at(id)); }

std::optional<UnitIndex> Scheduler::IndexOf(const UnitRef& unit) const {
  const auto found = jobs_by_id_.find(unit.job);
  if (found == jobs_by_id_.end()) return std::nullopt;
  const Job& job = jobs_.at(found->second);
  const int64_t frame = int64_t{unit.key.frame} - job.spec.first_frame();
  const std::optional<int64_t> number = job.units.NumberOf(unit.key);
  if (frame < 0 || frame >= job.spec.frame_count() || !number.has_value()) return std::nullopt;
  return UnitIndex{found->second, {static_cast<int>(frame), *number}};
}

UnitRef Scheduler::RefOf(const UnitIndex& index) const {
  const Job& job = jobs_.at(index.job);
  return {job.id, job.units.KeyOf(job.spec.first_frame() + index.place.frame, index.place.number)};
}

Scheduler::Frame& Scheduler::ActiveFrame(Job& job, int frame) {
  const auto [it, is_new] = job.frames.try_emplace(frame);
  if (is_new) it->second.taken.resize(static_cast<size_t>(job.units.count()));
  return it->second;
}

void Scheduler::UpdateReady(int64_t number, const Job& job) {
  if (!job.returned.empty() || job.next_unleased.frame < job.spec.frame_count()) {
    ready_[job.numeric_class].insert(number);
  } else {
    RemoveReady(number, job);
  }
}

void Scheduler::RemoveReady(int64_t number, const Job& job) {
  const auto ready = ready_.find(job.numeric_class);
  if (ready == ready_.end()) return;
  ready->second.erase(number);
  if (ready->second.empty()) ready_.erase(ready);
}

bool Scheduler::HasReady(const std::string& numeric_class) const {
  return ready_.contains("") || ready_.contains(numeric_class);
}

std::optional<int64_t> Scheduler::NextReady(const std::string& numeric_class, int64_t number) const {
  std::optional<int64_t> next;
  for (const std::string& key : {std::string(), numeric_class}) {
    const auto ready = ready_.find(key);
    if (ready == ready_.end()) continue;
    const auto found = ready->second.upper_bound(number);
    if (found != ready->second.end() && (!next.has_value() || *found < *next)) next = *found;
  }
  return next;
}

std::optional<Place> Scheduler::TakeUnit(int64_t job_number, WorkerId worker, SkipBudget* budget) {
  const std::optional<Place> returned = TakeReturnedUnit(job_number, worker, budget);
  return returned.has_value() ? returned : TakeUnleasedUnit(jobs_.at(job_number));
}

bool Scheduler::IsExcluded(const Job& job, const UnitIndex& index, WorkerId worker) const {
  for (const Attempt attempt : leases_.OfUnit(index)) {
    if (leases_.Find(attempt)->worker == worker) return true;
  }
  const auto history = job.history.find(index.place);
  return history != job.history.end() && history->second.failures > 0 &&
         history->second.last_failed == worker && workers_.HasOther(worker, job.numeric_class);
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

std::optional<Place> Scheduler::TakeUnleasedUnit(Job& job) {
  for (; job.next_unleased.frame < job.spec.frame_count();
       job.next_unleased = {job.next_unleased.frame + 1, 0}) {
    if (job.finished[static_cast<size_t>(job.next_unleased.frame)]) continue;
    const Frame& frame = ActiveFrame(job, job.next_unleased.frame);
    while (job.next_unleased.number < job.units.count()) {
      const Place place = job.next_unleased;
      ++job.next_unleased.number;
      if (!frame.taken[static_cast<size_t>(place.number)]) return place;
    }
  }
  return std::nullopt;
}

GrantedLease Scheduler::Grant(const UnitIndex& index, WorkerId worker, absl::Time now, bool alone) {
  const Attempt attempt(next_attempt_++);
  leases_.Add(attempt, {.unit = index,
                        .worker = worker,
                        .granted = now,
                        .deadline = now + std::min(options_.lease, options_.stall),
                        .progressed = now,
                        .check = alone ? absl::InfiniteFuture() : OverdueTime(index, now),
                        .alone = alone});
  workers_.TakeSlot(worker);
  const UnitRef unit = RefOf(index);
  const FrameUnits& units = jobs_.at(index.job).units;
  return {worker, unit, attempt, units.tiles().RectOf(unit.key.tile), units.SamplesOf(unit.key), alone};
}

void Scheduler::VoidLease(Attempt attempt) {
  const Lease lease = leases_.Remove(attempt);
  ReleaseSlot(lease.worker);
  if (MayReturn(lease.unit)) Return(lease.unit);
}

void Scheduler::ReleaseSlot(WorkerId worker) {
  workers_.ReleaseSlot(worker);
  const auto reservation = reservations_.find(worker);
  if (reservation == reservations_.end() || !reservation->second.granted) return;
  if (workers_.Find(worker)->busy > 0) return;
  reservations_.erase(reservation);
  workers_.SetReserved(worker, false);
}

bool Scheduler::MayReturn(const UnitIndex& index) const {
  const std::vector<Attempt> attempts = leases_.OfUnit(index);
  return attempts.size() < kMaxLeasesOfUnit &&
         std::all_of(attempts.begin(), attempts.end(),
                     [this](Attempt attempt) { return leases_.Find(attempt)->is_overdue; });
}

void Scheduler::Return(const UnitIndex& index) {
  if (IsSuspect(index)) {
    quarantine_.insert(index);
    return;
  }
  Job& job = jobs_.at(index.job);
  job.returned.insert(index.place);
  UpdateReady(index.job, job);
}

void Scheduler::CountCommitted(Job& job, const Place& place) {
  ++job.frames.at(place.frame).committed;
  ++job.committed_units;
  job.committed_samples += job.units.CameraSamplesOf(job.units.KeyOf(0, place.number));
}

}  // namespace lumifold::scheduler
