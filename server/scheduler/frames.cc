#include "server/scheduler/frames.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "server/job/plan.h"

namespace lumifold::scheduler {

using job::FrameRounds;
using job::JobId;

int64_t Frames::in_flight() const {
  int64_t frames = 0;
  for (const auto& [number, job] : state_->jobs.all())
    frames += static_cast<int64_t>(job.frames.active().size());
  return frames;
}

bool Frames::SetRounds(const JobId& id, int32_t frame_number, std::shared_ptr<const FrameRounds> rounds) {
  Job* job = state_->jobs.Find(id);
  if (job == nullptr || job->units.first_rounds() == nullptr) return false;
  const std::optional<int> frame = job->units.frames().IndexOf(frame_number);
  if (!frame.has_value() || job->frames.IsOver(*frame)) return false;
  Open(*job, *frame);
  const std::vector<Place> added = job->frames.SetRounds(*frame, std::move(rounds), job->units);
  for (const Place& place : added) job->free.Return(place);
  job->units.AddLater(static_cast<int64_t>(added.size()));
  state_->UpdateReady(*job);
  return UpdateCommitted(*job, *frame);
}

const FrameState* Frames::Find(const JobId& id, int32_t frame) const {
  const Job* job = state_->jobs.Find(id);
  if (job == nullptr) return nullptr;
  const std::optional<int> index = job->units.frames().IndexOf(frame);
  return index.has_value() ? job->frames.Find(*index) : nullptr;
}

std::shared_ptr<const FrameRounds> Frames::RoundsOf(const JobId& id, int32_t frame_number) const {
  const FrameState* frame = Find(id, frame_number);
  return frame == nullptr ? nullptr : frame->rounds;
}

int Frames::CommittedRounds(const JobId& id, int32_t frame_number) const {
  const FrameState* frame = Find(id, frame_number);
  if (frame == nullptr || frame->rounds == nullptr) return 0;
  const std::vector<int64_t>& left = frame->left;
  const auto first = std::find_if(left.begin(), left.end(), [](int64_t units) { return units > 0; });
  return std::max(0, static_cast<int>(first - left.begin()) - 1);
}

std::vector<int32_t> Frames::Committed(const JobId& id) const {
  const Job& job = state_->jobs.Get(id);
  std::vector<int32_t> frames;
  for (const int frame : job.frames.committed()) frames.push_back(job.units.frames().NumberOf(frame));
  return frames;
}

bool Frames::IsCommitted(const JobId& id, int32_t frame_number) const {
  const Job* job = state_->jobs.Find(id);
  if (job == nullptr) return false;
  const std::optional<int> frame = job->units.frames().IndexOf(frame_number);
  return frame.has_value() && job->frames.committed().contains(*frame);
}

std::vector<std::pair<JobId, int32_t>> Frames::TakeSettled() { return std::exchange(settled_, {}); }

bool Frames::Finish(const JobId& id, int32_t frame_number) {
  Job* job = state_->jobs.Find(id);
  if (job == nullptr) return false;
  const std::optional<int> index = job->units.frames().IndexOf(frame_number);
  const FrameState* frame = index.has_value() ? job->frames.Find(*index) : nullptr;
  if (!index.has_value() || frame == nullptr || !JobFrames::IsComplete(*frame, job->units) ||
      state_->audits.HasOpen(job->number, *index))
    return false;
  ReleaseDeliverers(*frame);
  job->frames.Finish(*index);
  if (!job->paused) state_->ready.CountFrames(job->number, -1);
  return job->frames.AreAllOver();
}

bool Frames::RestoreFinished(const JobId& id, int32_t frame_number) {
  Job* job = state_->jobs.Find(id);
  if (job == nullptr) return false;
  const std::optional<int> frame = job->units.frames().IndexOf(frame_number);
  if (!frame.has_value()) return false;
  job->frames.RestoreFinished(*frame, job->units);
  state_->UpdateReady(*job);
  return true;
}

void Frames::Skip(const JobId& id, int32_t frame_number) {
  Job* job = state_->jobs.Find(id);
  if (job == nullptr || job::NeedsPlan(job->units.spec())) return;
  const std::optional<int> frame = job->units.frames().IndexOf(frame_number);
  if (!frame.has_value() || job->frames.IsOver(*frame)) return;
  job->frames.Skip(*frame);
  job->units.AddLater(-job->units.ordered());
  state_->UpdateReady(*job);
}

FrameState& Frames::Open(Job& job, int frame) {
  FrameState* active = job.frames.Find(frame);
  if (active != nullptr) return *active;
  FrameState& opened = job.frames.Open(frame, job.units);
  if (!job.paused) state_->ready.CountFrames(job.number, 1);
  return opened;
}

void Frames::CountActive(const Job& job, bool are_counted) {
  if (job.paused) return;
  const int frames = static_cast<int>(job.frames.active().size()) - state_->jobs.kept().CountOf(job.number);
  state_->ready.CountFrames(job.number, are_counted ? frames : -frames);
}

void Frames::Leave(const Job& job) {
  for (const auto& [index, frame] : job.frames.active()) ReleaseDeliverers(frame);
  CountActive(job, false);
}

bool Frames::UpdateCommitted(Job& job, int index) {
  const FrameState& frame = *job.frames.Find(index);
  const bool is_committed = JobFrames::IsComplete(frame, job.units) && frame.revoking.empty() &&
                            !state_->audits.HasOpen(job.number, index);
  job.frames.MarkCommitted(index, is_committed);
  return is_committed;
}

void Frames::OnAuditEnded(Job& job, int frame) {
  state_->UpdateReady(job);
  if (UpdateCommitted(job, frame)) settled_.emplace_back(job.id, job.units.frames().NumberOf(frame));
}

void Frames::ReleaseDeliverers(const FrameState& frame) {
  for (const uint32_t number : frame.deliverers) state_->deliverers.Release(number);
}

}  // namespace lumifold::scheduler
