// What is due for a frame once units of it are committed: its result, or with adaptive sampling the estimate of a round.
#include <spdlog/logger.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"
#include "server/finish/estimate_round.h"

namespace lumifold::server {

bool Coordinator::IsDue(const CommittedFrame& frame) {
  if (frame.round == CommittedFrame::kResult) return scheduler_.IsFrameCommitted(frame.job, frame.number);
  const std::shared_ptr<const job::FrameRounds> rounds = scheduler_.RoundsOf(frame.job, frame.number);
  return rounds != nullptr && !rounds->is_final() && rounds->estimated() == frame.round &&
         scheduler_.CommittedRounds(frame.job, frame.number) > frame.round;
}

void Coordinator::QueueDue(const FrameKey& key) {
  CommittedFrame frame = {.job = key.first, .number = key.second};
  if (!IsDue(frame)) {
    const std::shared_ptr<const job::FrameRounds> rounds = scheduler_.RoundsOf(frame.job, frame.number);
    if (rounds == nullptr) return;
    frame.round = rounds->estimated();
    if (!IsDue(frame)) return;
  }
  const bool is_queued = std::any_of(
      committed_frames_.begin(), committed_frames_.end(),
      [&](const CommittedFrame& queued) { return queued.key() == key && queued.round == frame.round; });
  if (is_queued) return finishing_.Notify();
  if (const auto active = active_jobs_.find(frame.job); active != active_jobs_.end())
    frame.rendered = absl::Seconds(active->second.times.render_seconds());
  frame.samples = scheduler_.Progress(frame.job).samples_done;
  committed_frames_.push_back(std::move(frame));
  finishing_.Notify();
}

void Coordinator::OnRoundEstimated(const CommittedFrame& frame, const v1::FrameReport& report) {
  v1::JobSpec spec;
  {
    absl::MutexLock lock(&mutex_);
    const auto active = active_jobs_.find(frame.job);
    if (active == active_jobs_.end()) return;
    spec = active->second.spec;
  }
  absl::StatusOr<job::FrameRounds> rounds = ReadRounds(folder_, frame.job, spec, frame.number);
  absl::MutexLock lock(&mutex_);
  if (!active_jobs_.contains(frame.job)) return;
  if (!rounds.ok()) return EndJob(frame.job, v1::JOB_STATE_FAILED, std::string(rounds.status().message()));
  options_.log->info(
      "event=round_estimated job={} frame={} round={} rounds={} final={} error={:.4g} seconds={:.3f}",
      frame.job.value(), frame.number, frame.round, rounds->count(), rounds->is_final(),
      rounds->predicted_error(), report.times().filter_seconds());
  if (rounds->predicted_error() >= 0) predicted_errors_[frame.job] = rounds->predicted_error();
  scheduler_.SetRounds(frame.job, frame.number, std::make_shared<const job::FrameRounds>(*std::move(rounds)));
  QueueDue(frame.key());
  changed_jobs_.insert(frame.job);
  housekeeping_.Notify();
  GrantLeases();
}

}  // namespace lumifold::server
