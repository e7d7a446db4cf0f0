#include "server/scheduler/scheduler.h"

#include <algorithm>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::FrameUnits;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

Scheduler::Scheduler(const SchedulerOptions& options)
    : options_(options), next_attempt_(options.first_attempt.value()) {}

void Scheduler::AddJob(const JobId& job, const v1::JobSpec& spec, const std::string& numeric_class) {
  LUMIFOLD_CHECK(!HasJob(job));
  const int64_t number = next_job_++;
  jobs_by_id_.emplace(job, number);
  jobs_.emplace(number, Job{.id = job,
                            .spec = spec,
                            .units = FrameUnits(spec),
                            .numeric_class = numeric_class,
                            .frames = {},
                            .finished = std::vector<bool>(static_cast<size_t>(spec.frame_count())),
                            .next_unleased = {},
                            .returned = {},
                            .failures = {}});
}

bool Scheduler::RestoreCommittedUnit(const UnitRef& unit) {
  const std::optional<LeaseKey> key = KeyOf(unit);
  if (!key.has_value()) return false;
  Job& job = jobs_.at(key->job);
  if (job.finished[static_cast<size_t>(key->place.frame)]) return true;  // counted with its frame
  Frame& frame = ActiveFrame(job, key->place.frame);
  const auto number = static_cast<size_t>(key->place.number);
  if (frame.taken[number]) return true;
  frame.taken[number] = true;
  CountCommitted(job, key->place);
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
  for (auto it = leases_.lower_bound({number, {}}); it != leases_.end() && it->first.job == number;) {
    ReleaseSlot(it->second.worker);
    it = leases_.erase(it);
  }
  for (auto it = accepted_.lower_bound({number, {}}); it != accepted_.end() && it->first.job == number;) {
    ReleaseSlot(it->second);
    it = accepted_.erase(it);
  }
  jobs_.erase(number);
  jobs_by_id_.erase(found);
}

void Scheduler::AddWorker(WorkerId worker, const std::string& numeric_class, int slots) {
  LUMIFOLD_CHECK(slots >= 1);
  const bool is_new = workers_.emplace(worker, Worker{.numeric_class = numeric_class, .slots = slots}).second;
  LUMIFOLD_CHECK(is_new);
}

void Scheduler::RemoveWorker(WorkerId worker) {
  for (auto it = leases_.begin(); it != leases_.end();) {
    it = it->second.worker == worker ? VoidLease(it) : std::next(it);
  }
  workers_.erase(worker);
}

void Scheduler::Heartbeat(WorkerId worker, absl::Span<const std::pair<UnitRef, Attempt>> held, Attempt newest,
                          absl::Time now) {
  const auto found = workers_.find(worker);
  if (found != workers_.end()) found->second.unresponsive = false;
  std::set<Attempt> named;
  for (const auto& [unit, attempt] : held) {
    if (HoldsLease(worker, unit, attempt)) named.insert(attempt);
  }
  for (auto it = leases_.begin(); it != leases_.end();) {
    Lease& lease = it->second;
    const bool received = lease.worker == worker && lease.attempt <= newest;
    if (received && !named.contains(lease.attempt)) {
      it = VoidLease(it);
      continue;
    }
    if (lease.worker == worker && named.contains(lease.attempt)) lease.deadline = now + options_.lease;
    ++it;
  }
}

std::vector<ExpiredLease> Scheduler::ExpireLeases(absl::Time now) {
  std::vector<ExpiredLease> expired;
  for (auto it = leases_.begin(); it != leases_.end();) {
    if (it->second.deadline > now) {
      ++it;
      continue;
    }
    expired.push_back({RefOf(it->first), it->second.worker});
    workers_.at(it->second.worker).unresponsive = true;
    it = VoidLease(it);
  }
  return expired;
}

absl::Time Scheduler::NextExpiry() const {
  absl::Time next = absl::InfiniteFuture();
  for (const auto& [key, lease] : leases_) next = std::min(next, lease.deadline);
  return next;
}

std::vector<GrantedLease> Scheduler::GrantLeases(WorkerId worker_id, absl::Time now) {
  std::vector<GrantedLease> granted;
  const auto found = workers_.find(worker_id);
  if (found == workers_.end() || found->second.unresponsive) return granted;
  Worker& worker = found->second;
  for (auto& [number, job] : jobs_) {
    if (!job.numeric_class.empty() && job.numeric_class != worker.numeric_class) continue;
    while (worker.busy < worker.slots) {
      std::optional<Place> place = TakeReturnedUnit(job, worker_id);
      if (!place.has_value()) place = TakeUnleasedUnit(job);
      if (!place.has_value()) break;
      job.numeric_class = worker.numeric_class;
      ++worker.busy;
      granted.push_back(Grant(number, job, *place, worker_id, now));
    }
  }
  return granted;
}

bool Scheduler::HoldsLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  const std::optional<LeaseKey> key = KeyOf(unit);
  if (!key.has_value()) return false;
  const auto lease = leases_.find(*key);
  return lease != leases_.end() && lease->second.worker == worker && lease->second.attempt == attempt;
}

Completion Scheduler::CompleteUnit(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  const std::optional<LeaseKey> key = KeyOf(unit);
  if (!key.has_value()) return Completion::kUnknown;
  Job& job = jobs_.at(key->job);
  const auto frame = job.frames.find(key->place.frame);
  const bool finished = job.finished[static_cast<size_t>(key->place.frame)];
  if (finished ||
      (frame != job.frames.end() && frame->second.taken[static_cast<size_t>(key->place.number)])) {
    return Completion::kDuplicate;
  }
  if (!HoldsLease(worker, unit, attempt)) return Completion::kStale;
  leases_.erase(*key);
  accepted_.emplace(*key, worker);
  frame->second.taken[static_cast<size_t>(key->place.number)] = true;
  return Completion::kAccepted;
}

bool Scheduler::UnitCommitted(const UnitRef& unit) {
  const std::optional<LeaseKey> key = KeyOf(unit);
  if (!key.has_value()) return false;  // the job ended while the unit was being committed
  const auto accepted = accepted_.find(*key);
  LUMIFOLD_CHECK(accepted != accepted_.end());
  ReleaseSlot(accepted->second);
  accepted_.erase(accepted);
  Job& job = jobs_.at(key->job);
  CountCommitted(job, key->place);
  return job.frames.at(key->place.frame).committed == job.units.count();
}

FailureOutcome Scheduler::FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, bool permanent) {
  if (!HoldsLease(worker, unit, attempt)) return FailureOutcome::kIgnored;
  const LeaseKey key = *KeyOf(unit);
  VoidLease(leases_.find(key));
  Failures& failures = jobs_.at(key.job).failures[key.place];
  failures = {failures.count + 1, worker};
  return permanent || failures.count >= options_.max_failures ? FailureOutcome::kJobFails
                                                              : FailureOutcome::kRetried;
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
  const int64_t number = jobs_by_id_.at(id);
  for (auto it = leases_.lower_bound({number, {}}); it != leases_.end() && it->first.job == number; ++it) {
    holders.insert(it->second.worker);
  }
  progress.workers = static_cast<int>(holders.size());
  if (job.finished_count == job.spec.frame_count()) {
    progress.state = v1::JOB_STATE_DONE;
  } else if (!CommittedFrames(id).empty()) {
    progress.state = v1::JOB_STATE_FILTERING;
  } else {
    progress.state = job.numeric_class.empty() ? v1::JOB_STATE_QUEUED : v1::JOB_STATE_RENDERING;
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

std::optional<Scheduler::LeaseKey> Scheduler::KeyOf(const UnitRef& unit) const {
  const auto found = jobs_by_id_.find(unit.job);
  if (found == jobs_by_id_.end()) return std::nullopt;
  const Job& job = jobs_.at(found->second);
  const int64_t frame = int64_t{unit.key.frame} - job.spec.first_frame();
  const std::optional<int64_t> number = job.units.NumberOf(unit.key);
  if (frame < 0 || frame >= job.spec.frame_count() || !number.has_value()) return std::nullopt;
  return LeaseKey{found->second, {static_cast<int>(frame), *number}};
}

UnitRef Scheduler::RefOf(const LeaseKey& key) const {
  const Job& job = jobs_.at(key.job);
  return {job.id, job.units.KeyOf(job.spec.first_frame() + key.place.frame, key.place.number)};
}

Scheduler::Frame& Scheduler::ActiveFrame(Job& job, int frame) {
  const auto [it, is_new] = job.frames.try_emplace(frame);
  if (is_new) it->second.taken.resize(static_cast<size_t>(job.units.count()));
  return it->second;
}

bool Scheduler::HasOtherWorkerOfSameClass(WorkerId worker) const {
  const std::string& numeric_class = workers_.at(worker).numeric_class;
  return std::any_of(workers_.begin(), workers_.end(), [&](const auto& entry) {
    return entry.first != worker && entry.second.numeric_class == numeric_class;
  });
}

std::optional<Scheduler::Place> Scheduler::TakeReturnedUnit(Job& job, WorkerId worker) {
  for (auto it = job.returned.begin(); it != job.returned.end(); ++it) {
    const auto failures = job.failures.find(*it);
    if (failures != job.failures.end() && failures->second.last == worker &&
        HasOtherWorkerOfSameClass(worker))
      continue;
    const Place place = *it;
    job.returned.erase(it);
    return place;
  }
  return std::nullopt;
}

std::optional<Scheduler::Place> Scheduler::TakeUnleasedUnit(Job& job) {
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

GrantedLease Scheduler::Grant(int64_t job_number, Job& job, const Place& place, WorkerId worker,
                              absl::Time now) {
  const Attempt attempt(next_attempt_++);
  const LeaseKey key{job_number, place};
  leases_.emplace(key, Lease{worker, attempt, now + options_.lease});
  const UnitRef unit = RefOf(key);
  return {unit, attempt, job.units.tiles().RectOf(unit.key.tile), job.units.SamplesOf(unit.key)};
}

std::map<Scheduler::LeaseKey, Scheduler::Lease>::iterator Scheduler::VoidLease(
    std::map<LeaseKey, Lease>::iterator lease) {
  jobs_.at(lease->first.job).returned.insert(lease->first.place);
  ReleaseSlot(lease->second.worker);
  return leases_.erase(lease);
}

void Scheduler::ReleaseSlot(WorkerId worker) {
  const auto found = workers_.find(worker);
  if (found != workers_.end())
    --found->second.busy;  // the worker may have disconnected after it delivered the unit
}

void Scheduler::CountCommitted(Job& job, const Place& place) {
  ++job.frames.at(place.frame).committed;
  ++job.committed_units;
  job.committed_samples += job.units.CameraSamplesOf(job.units.KeyOf(0, place.number));
}

}  // namespace lumifold::scheduler
