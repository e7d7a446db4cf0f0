#include "server/scheduler/scheduler.h"

#include <algorithm>
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

/// Accepted units of a job and kind from which their mean time is used: the first ones load the scene.
constexpr int kMinTimedUnits = 8;

/// Place in Frame::left.
size_t RoundIndexOf(const job::UnitKey& key) {
  return key.kind == v1::UNIT_KIND_GEOMETRY ? 0 : static_cast<size_t>(1 + key.pass);
}

}  // namespace

Scheduler::Scheduler(const SchedulerOptions& options)
    : options_(options), next_attempt_(options.first_attempt.value()) {}

void Scheduler::AddJob(const JobId& id, const v1::JobSpec& spec, const JobOptions& options) {
  LUMIFOLD_CHECK(!HasJob(id));
  const int64_t number = next_job_++;
  jobs_by_id_.emplace(id, number);
  Job& job = jobs_.emplace(number, Job(id, spec)).first->second;
  share_.AddJob(number, options.user, options.priority);
  job.max_leases = options.max_leases;
  job.audit_share = options.audit_share;
  job.paused = options.paused;
  SetDemand(job, Requirement::Of(options.numeric_class, options.tags));
  UpdateReady(number, job);
}

void Scheduler::PauseJob(const JobId& id) {
  Job* job = FindJob(id);
  if (job == nullptr || job->paused) return;
  CountFrames(*job, -static_cast<int>(job->frames.size()));
  job->paused = true;
  const int64_t number = jobs_by_id_.at(id);
  UpdateReady(number, *job);
  std::vector<WorkerId> waiting;
  for (const auto& [worker, reservation] : reservations_) {
    if (reservation.unit.job == number) waiting.push_back(worker);
  }
  for (const WorkerId worker : waiting) CancelReservation(worker);
}

void Scheduler::ResumeJob(const JobId& id) {
  Job* job = FindJob(id);
  if (job == nullptr || !job->paused) return;
  job->paused = false;
  CountFrames(*job, static_cast<int>(job->frames.size()));
  UpdateReady(jobs_by_id_.at(id), *job);
}

void Scheduler::SetPriority(const JobId& id, int priority) {
  if (HasJob(id)) share_.SetPriority(jobs_by_id_.at(id), priority);
}

void Scheduler::SetMaxActiveFrames(int frames) {
  LUMIFOLD_CHECK(frames >= 1);
  max_active_frames_ = frames;
}

bool Scheduler::RestoreCommittedUnit(const JobId& id, const RestoredUnit& unit, absl::Time now) {
  latest_ = std::max(latest_, now);
  const UnitRef ref{id, unit.key};
  const std::optional<UnitIndex> index = IndexOf(ref);
  if (!index.has_value()) return false;
  Job& job = jobs_.at(index->job);
  if (job.finished[static_cast<size_t>(index->place.frame)]) return true;  // counted with its frame
  Frame& frame = ActiveFrame(job, index->place.frame);
  const auto number = static_cast<size_t>(index->place.number);
  if (frame.rounds != nullptr && !frame.rounds->Has(unit.key)) return false;
  if (frame.taken[number]) return true;
  frame.taken[number] = true;
  job.returned.erase(index->place);
  if (!unit.worker.empty()) frame.deliverers[number] = deliverers_.Acquire(unit.worker);
  CountCommitted(job, index->place);
  if (IsAudited(ref, job.audit_share)) StartAudit(*index, unit.worker, unit.digest, now);
  UpdateReady(index->job, job);
  return true;
}

bool Scheduler::RestoreFinishedFrame(const JobId& id, int32_t frame_number) {
  Job* job = FindJob(id);
  if (job == nullptr) return false;
  const std::optional<int> frame = job->frame_list.IndexOf(frame_number);
  if (!frame.has_value()) return false;
  LUMIFOLD_CHECK(!job->frames.contains(*frame));  // finished frames are restored first
  if (job->finished[static_cast<size_t>(*frame)]) return true;
  job->finished[static_cast<size_t>(*frame)] = true;
  ++job->finished_count;
  job->committed_units += job->ordered_units();
  job->committed_samples += int64_t{job->spec.width()} * job->spec.height() * job->spec.samples_per_pixel();
  UpdateReady(jobs_by_id_.at(id), *job);
  return true;
}

void Scheduler::EndJob(const JobId& id) {
  const auto found = jobs_by_id_.find(id);
  if (found == jobs_by_id_.end()) return;
  const int64_t number = found->second;
  for (const Attempt attempt : leases_.OfJob(number)) {
    const Lease lease = RemoveLease(attempt);
    newly_voided_.push_back({lease.worker, RefOf(lease.unit), attempt});
    ReleaseSlot(lease.worker);
  }
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
  Job& job = jobs_.at(number);
  for (const auto& [frame, state] : job.frames) ReleaseDeliverers(state);
  CountFrames(job, -static_cast<int>(job.frames.size()));
  LeaveDemand(number, job);
  share_.RemoveJob(number);
  for (auto& [instance, units] : lost_with_)
    std::erase_if(units, [number](const UnitIndex& unit) { return unit.job == number; });
  std::erase_if(lost_with_, [](const auto& entry) { return entry.second.empty(); });
  jobs_.erase(number);
  jobs_by_id_.erase(found);
}

const Lease* Scheduler::FindLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  const Lease* lease = leases_.Find(attempt);
  return lease != nullptr && lease->worker == worker && lease->unit == IndexOf(unit) ? lease : nullptr;
}

bool Scheduler::HasResult(const UnitRef& unit) const {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return false;
  const Job& job = jobs_.at(index->job);
  if (job.finished[static_cast<size_t>(index->place.frame)]) return true;
  const auto frame = job.frames.find(index->place.frame);
  return frame != job.frames.end() && frame->second.taken[static_cast<size_t>(index->place.number)];
}

bool Scheduler::HoldsLease(WorkerId worker, const UnitRef& unit, Attempt attempt) const {
  return FindLease(worker, unit, attempt) != nullptr;
}

Completion Scheduler::CompleteUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, absl::Time now,
                                   absl::string_view digest) {
  latest_ = std::max(latest_, now);
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return Completion::kUnknown;
  Job& job = jobs_.at(index->job);
  const auto frame = job.frames.find(index->place.frame);
  if (HasResult(unit)) {
    const Lease* audit = FindLease(worker, unit, attempt);
    if (audit == nullptr) return Completion::kDuplicate;
    CompleteAudit(attempt, digest, now);
    return Completion::kAudited;
  }
  if (!HoldsLease(worker, unit, attempt)) return Completion::kStale;
  const Lease lease = RemoveLease(attempt);
  workers_.Change(worker, [&](Worker& state) {
    ++state.units_done;
    state.unit_time += now - lease.granted;
  });
  RateWorker(lease, now);
  CountTime(lease, now);
  BlameOthers(*index, worker, now);
  VoidOtherLeases(*index);
  job.is_bound = true;
  if (RequirementOf(job).numeric_class.empty()) Bind(index->job, workers_.Find(worker)->traits.numeric_class);
  accepted_.emplace(*index, worker);
  const auto number = static_cast<size_t>(index->place.number);
  const std::string& name = workers_.Find(worker)->traits.name;
  frame->second.taken[number] = true;
  frame->second.deliverers[number] = deliverers_.Acquire(name);
  if (IsAudited(unit, job.audit_share)) StartAudit(*index, name, digest, now);
  return Completion::kAccepted;
}

void Scheduler::VoidOtherLeases(const UnitIndex& index) {
  for (const Attempt attempt : leases_.OfUnit(index)) RevokeLease(attempt);
  Job& job = jobs_.at(index.job);
  job.returned.erase(index.place);
  UpdateReady(index.job, job);
  if (job.history.contains(index.place)) RemoveFromQuarantine(index);
  job.history.erase(index.place);
}

size_t Scheduler::SizeClassOf(const Job& job, const Place& place) {
  const job::UnitKey key = job.units.KeyOf(0, place.number);
  if (key.kind == v1::UNIT_KIND_GEOMETRY) return 0;
  return key.pass == 0 && job.spec.first_pass_samples() > 0 ? 1 : 2;
}

const Scheduler::UnitTimes& Scheduler::TimesOf(const Job& job, const Place& place) {
  return job.times[SizeClassOf(job, place)];
}

Scheduler::UnitTimes& Scheduler::TimesOf(Job& job, const Place& place) {
  return job.times[SizeClassOf(job, place)];
}

void Scheduler::CountTime(const Lease& lease, absl::Time now) {
  Job& job = jobs_.at(lease.unit.job);
  UnitTimes& times = TimesOf(job, lease.unit.place);
  ++times.count;
  times.sum += now - lease.granted;
  if (times.count != kMinTimedUnits) return;
  for (const Attempt attempt : leases_.OfJob(lease.unit.job)) {
    Schedule(attempt, *leases_.Find(attempt));
  }
}

std::optional<absl::Duration> Scheduler::MeanTime(const UnitIndex& index) const {
  const UnitTimes& times = TimesOf(jobs_.at(index.job), index.place);
  return times.count < kMinTimedUnits ? std::nullopt : std::optional(times.sum / times.count);
}

absl::Time Scheduler::OverdueTime(const UnitIndex& index, absl::Time granted) const {
  const std::optional<absl::Duration> mean = MeanTime(index);
  if (!mean.has_value()) return absl::InfiniteFuture();
  return granted + std::max(options_.overdue_factor * *mean, options_.overdue_least);
}

void Scheduler::Schedule(Attempt attempt, Lease lease) {
  if (lease.alone || lease.audit || lease.is_overdue) return;
  lease.check = lease.is_late ? OverdueTime(lease.unit, lease.granted)
                              : LateTime(lease.unit, lease.worker, lease.granted);
  leases_.Update(attempt, lease);
}

void Scheduler::Bind(int64_t number, const std::string& numeric_class) {
  Job& job = jobs_.at(number);
  Requirement requirement = RequirementOf(job);
  requirement.numeric_class = numeric_class;
  const int frames = static_cast<int>(job.frames.size());
  CountFrames(job, -frames);
  for (const Attempt attempt : leases_.OfJob(number)) {
    Lease lease = *leases_.Find(attempt);
    if (!lease.is_late) continue;
    job.demand->second.late.erase({lease.expected_end, attempt});
    lease.is_late = false;  // it is late again at the next check
    if (!lease.is_overdue) lease.check = latest_;
    leases_.Update(attempt, lease);
  }
  LeaveDemand(number, job);
  SetDemand(job, requirement);
  CountFrames(job, frames);
  UpdateReady(number, job);
  for (const Attempt attempt : leases_.OfJob(number)) {
    const Worker& worker = *workers_.Find(leases_.Find(attempt)->worker);
    if (worker.traits.numeric_class != numeric_class && RevokeLease(attempt))
      ++retries_[RetryReason::kOtherClass];
  }
}

void Scheduler::SetDemand(Job& job, const Requirement& requirement) {
  job.demand = demands_.try_emplace(requirement).first;
  ++job.demand->second.jobs;
}

void Scheduler::LeaveDemand(int64_t number, Job& job) {
  SetReadiness(number, job, Readiness::kNone);  // other jobs may keep the demand
  if (--job.demand->second.jobs == 0) demands_.erase(job.demand);
}

void Scheduler::CountFrames(const Job& job, int change) {
  if (job.paused || change == 0) return;
  job.demand->second.active_frames += change;
  if (workers_.Count(job.demand->first).available > 0) live_frames_ += change;
}

void Scheduler::RecountLiveFrames() {
  counted_kinds_ = workers_.version();
  live_frames_ = active_frames();
}

int Scheduler::active_frames() const {
  int frames = 0;
  for (const auto& [requirement, demand] : demands_) {
    if (workers_.Count(requirement).available > 0) frames += demand.active_frames;
  }
  return frames;
}

int64_t Scheduler::frames_in_flight() const {
  int64_t frames = 0;
  for (const auto& [number, job] : jobs_) frames += static_cast<int64_t>(job.frames.size());
  return frames;
}

bool Scheduler::UnitCommitted(const UnitRef& unit) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return false;  // the job ended while the unit was being committed
  EndAccepted(*index);
  Job& job = jobs_.at(index->job);
  CountCommitted(job, index->place);
  const Frame& frame = job.frames.at(index->place.frame);
  if (frame.revoking.contains(index->place.number)) {  // its worker was found faulty meanwhile
    const std::string name = deliverers_.NameOf(frame.deliverers[static_cast<size_t>(index->place.number)]);
    newly_faulty_.push_back({name, "", {unit}});
  }
  return job.committed_frames.contains(index->place.frame);
}

void Scheduler::EndAccepted(const UnitIndex& index) {
  const auto accepted = accepted_.find(index);
  LUMIFOLD_CHECK(accepted != accepted_.end());
  ReleaseSlot(accepted->second);  // the worker may have disconnected since
  accepted_.erase(accepted);
}

void Scheduler::SetPlan(const UnitRef& unit, const v1::JobSpec& planned) {
  const std::optional<UnitIndex> index = IndexOf(unit);
  if (!index.has_value()) return;
  EndAccepted(*index);
  Job& job = jobs_.at(index->job);
  for (const auto& [frame, state] : job.frames) ReleaseDeliverers(state);
  CountFrames(job, -static_cast<int>(job.frames.size()));
  job.frames.clear();
  job.times = {};
  job.spec = planned;
  job.units = FrameUnits(planned);
  if (planned.has_adaptive()) job.first_rounds = std::make_shared<const job::FrameRounds>(planned);
  job.frame_list = job::FrameList(planned);
  job.finished.assign(static_cast<size_t>(job.frame_list.count()), false);
  job.next_unleased = {};
  job.ahead.clear();
  UpdateReady(index->job, job);
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
  frame->second.revoking.erase(place.number);
  deliverers_.Release(std::exchange(frame->second.deliverers[static_cast<size_t>(place.number)], 0));
  EndAudit(*index);
  for (const Attempt audit : leases_.OfUnit(*index)) RevokeLease(audit);
  UpdateCommitted(job, place.frame);
  --job.committed_units;
  job.committed_samples -= CameraSamplesOf(job, place);
  if (!frame->second.left.empty()) ++frame->second.left[RoundIndexOf(unit.key)];
  if (place < job.next_unleased || place.number >= job.ordered_units() || job.ahead.contains(place))
    job.returned.insert(place);  // otherwise it is leased in its turn
  UpdateReady(index->job, job);
  ++retries_[RetryReason::kTakenBack];
  return true;
}

std::vector<int32_t> Scheduler::CommittedFrames(const JobId& id) const {
  const Job& job = GetJob(id);
  std::vector<int32_t> frames;
  for (const int frame : job.committed_frames) frames.push_back(job.frame_list.NumberOf(frame));
  return frames;
}

bool Scheduler::IsFrameCommitted(const JobId& id, int32_t frame_number) const {
  if (!HasJob(id)) return false;
  const Job& job = GetJob(id);
  const std::optional<int> frame = job.frame_list.IndexOf(frame_number);
  return frame.has_value() && job.committed_frames.contains(*frame);
}

bool Scheduler::FrameFinished(const JobId& id, int32_t frame_number) {
  Job* job = FindJob(id);
  if (job == nullptr) return false;
  const int frame = job->frame_list.IndexOf(frame_number).value();
  const auto active = job->frames.find(frame);
  if (active == job->frames.end() || !IsFrameComplete(*job, active->second) || active->second.audits > 0)
    return false;
  job->committed_frames.erase(frame);
  ReleaseDeliverers(active->second);
  job->frames.erase(active);
  CountFrames(*job, -1);
  job->finished[static_cast<size_t>(frame)] = true;
  ++job->finished_count;
  return job->finished_count == job->frame_list.count();
}

const std::string& Scheduler::NumericClassOf(const JobId& id) const {
  return RequirementOf(GetJob(id)).numeric_class;
}
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
  const std::optional<int> frame = job.frame_list.IndexOf(unit.key.frame);
  const std::optional<int64_t> number = job.units.NumberOf(unit.key);
  if (!frame.has_value() || !number.has_value()) return std::nullopt;
  return UnitIndex{found->second, {*frame, *number}};
}

UnitRef Scheduler::RefOf(const UnitIndex& index) const {
  const Job& job = jobs_.at(index.job);
  return {job.id, job.units.KeyOf(job.frame_list.NumberOf(index.place.frame), index.place.number)};
}

Scheduler::Frame& Scheduler::ActiveFrame(Job& job, int frame) {
  const auto [it, is_new] = job.frames.try_emplace(frame);
  if (is_new) {
    it->second.taken.resize(static_cast<size_t>(job.units.count()));
    it->second.deliverers.resize(static_cast<size_t>(job.units.count()));
    it->second.rounds = job.first_rounds;
    if (job.first_rounds != nullptr)
      it->second.left.assign(static_cast<size_t>(job.first_rounds->count()) + 1, job.units.tiles().count());
    CountFrames(job, 1);
  }
  return it->second;
}

Lease Scheduler::RemoveLease(Attempt attempt) {
  const Lease lease = leases_.Remove(attempt);
  Job& job = jobs_.at(lease.unit.job);
  --job.lease_count;
  if (!lease.audit && leases_.OfUnit(lease.unit).empty()) --job.leased_units;
  share_.Ended(lease.unit.job, latest_ - lease.granted);
  if (lease.is_late) job.demand->second.late.erase({lease.expected_end, attempt});
  const auto holder = job.holders.find(lease.worker);
  if (--holder->second == 0) job.holders.erase(holder);
  if (job.max_leases > 0) UpdateReady(lease.unit.job, job);
  return lease;
}

bool Scheduler::VoidLease(Attempt attempt) {
  const Lease lease = RemoveLease(attempt);
  ReleaseSlot(lease.worker);
  if (lease.audit) {
    ReturnAudit(lease.unit);
    return false;
  }
  if (!MayReturn(lease.unit)) return false;
  Return(lease.unit);
  return true;
}

bool Scheduler::RevokeLease(Attempt attempt) {
  const Lease& lease = *leases_.Find(attempt);
  newly_voided_.push_back({lease.worker, RefOf(lease.unit), attempt});
  return VoidLease(attempt);
}

std::vector<VoidedLease> Scheduler::TakeVoided() { return std::exchange(newly_voided_, {}); }

void Scheduler::ReleaseSlot(WorkerId worker) {
  workers_.ReleaseSlot(worker);
  const auto reservation = reservations_.find(worker);
  if (reservation == reservations_.end() || !reservation->second.granted) return;
  if (workers_.Find(worker)->busy > 0) return;
  reservations_.erase(reservation);
  workers_.Change(worker, [](Worker& state) { state.reserved = false; });
}

bool Scheduler::MayReturn(const UnitIndex& index) const {
  const std::vector<Attempt> attempts = leases_.OfUnit(index);
  return attempts.size() < kMaxLeasesOfUnit &&
         std::all_of(
             attempts.begin(), attempts.end(),
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
  Frame& frame = job.frames.at(place.frame);
  ++frame.committed;
  if (!frame.left.empty()) --frame.left[RoundIndexOf(job.units.KeyOf(0, place.number))];
  ++job.committed_units;
  job.committed_samples += CameraSamplesOf(job, place);
  UpdateCommitted(job, place.frame);
}

}  // namespace lumifold::scheduler
