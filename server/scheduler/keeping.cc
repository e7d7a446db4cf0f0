#include "server/scheduler/keeping.h"

#include <cstddef>

#include "filter/image/check.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::JobId;
using job::WorkerId;

namespace {

/// So many frames that nobody has begun, for each worker that may render them: otherwise the last frames of a
/// job are shared by all workers.
constexpr int64_t kFramesPerWorker = 2;

}  // namespace

Keeping::Keeping(State* state, Frames* frames, Leasing* leasing)
    : state_(state), frames_(frames), leasing_(leasing) {}

void Keeping::SetDemand(const JobId& id, const KeepDemand& demand) {
  if (Job* const job = state_->jobs.Find(id); job != nullptr) job->keep = demand;
}

Job* Keeping::FindKept(const JobId& id, int32_t frame, int* index) const {
  Job* const job = state_->jobs.Find(id);
  if (job == nullptr) return nullptr;
  *index = job->units.frames().IndexOf(frame).value_or(-1);
  return state_->jobs.kept().Has({job->number, *index}) ? job : nullptr;
}

std::optional<WorkerId> Keeping::KeeperOf(const JobId& id, int32_t frame) const {
  int index = 0;
  const Job* const job = FindKept(id, frame, &index);
  return job == nullptr ? std::nullopt : state_->jobs.kept().KeeperOf({job->number, index});
}

int Keeping::CountOf(const JobId& id) const {
  const Job* const job = state_->jobs.Find(id);
  return job == nullptr ? 0 : state_->jobs.kept().CountOf(job->number);
}

std::vector<std::pair<JobId, int32_t>> Keeping::TakeBroken() {
  for (const WorkerId worker : state_->workers.TakeCeased()) state_->jobs.kept().BreakOf(worker);
  std::vector<std::pair<JobId, int32_t>> broken;
  for (const auto& [number, frame] : state_->jobs.kept().TakeBroken()) {
    const Job& job = state_->jobs.Get(number);
    broken.emplace_back(job.id, job.units.frames().NumberOf(frame));
  }
  return broken;
}

void Keeping::Close(const Job& job, int index) {
  state_->jobs.kept().Close({job.number, index});
  if (!job.paused) state_->ready.CountFrames(job.number, 1);
}

void Keeping::Stop(const JobId& id, int32_t frame) {
  int index = 0;
  Job* const job = FindKept(id, frame, &index);
  if (job == nullptr) return;
  Close(*job, index);
  const std::vector<bool>& taken = job->frames.Find(index)->taken;
  for (int64_t number = 0; number < static_cast<int64_t>(taken.size()); ++number) {
    if (taken[static_cast<size_t>(number)]) continue;
    const UnitIndex unit = {job->number, {index, number}};
    const std::vector<Attempt> attempts = state_->leases.OfUnit(unit);
    for (const Attempt attempt : attempts) leasing_->Revoke(attempt, RetryReason::kTakenBack);
    if (attempts.empty()) leasing_->Return(unit);
  }
  state_->UpdateReady(*job);
}

void Keeping::Exclude(WorkerId worker) {
  state_->workers.Change(worker, [](Worker& changed) { changed.traits.keep = {}; });
}

void Keeping::End(const JobId& id, int32_t frame) {
  int index = 0;
  if (const Job* const job = FindKept(id, frame, &index); job != nullptr) Close(*job, index);
}

std::optional<Place> Keeping::TakeUnit(Job& job, WorkerId worker) {
  return state_->jobs.kept().TakeNext(job.number, worker);
}

Keeping::Next Keeping::NextOf(const Job& job, WorkerId worker) const {
  if (job.keep.record_bytes == 0 || state_->ready.active_frames() < job.keep.least_in_flight)
    return Next::kTravels;
  const int64_t left = job.units.frames().count() - job.frames.finished_count() - job.frames.skipped_count() -
                       static_cast<int64_t>(job.frames.active().size());
  if (left < kFramesPerWorker * state_->workers.Count(state_->RequirementOf(job)).available)
    return Next::kTravels;
  const KeepOffer& offer = state_->workers.Find(worker)->traits.keep;
  const KeptFrames::Load load = state_->jobs.kept().LoadOf(worker);
  if (offer.frames == 0 || load.bytes + job.keep.record_bytes > offer.record_bytes ||
      job.keep.finish_bytes > offer.finish_bytes)
    return Next::kTravels;
  return load.frames < offer.frames ? Next::kIsKept : Next::kWaits;
}

Place Keeping::Begin(Job& job, WorkerId worker) {
  const int frame = job.free.next().frame;
  frames_->Open(job, frame);
  job.free.Pass(frame);
  state_->jobs.kept().Open({job.number, frame}, worker, job.units.ordered(), job.keep.record_bytes);
  if (!job.paused) state_->ready.CountFrames(job.number, -1);
  const std::optional<Place> first = state_->jobs.kept().TakeNext(job.number, worker);
  LUMIFOLD_CHECK(first.has_value());
  return *first;
}

}  // namespace lumifold::scheduler
