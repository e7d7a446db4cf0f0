// The coordinator's own threads: one finishes frames, one expires leases and notifies watchers.
#include <spdlog/logger.h>

#include <algorithm>
#include <string_view>

#include "server/coordinator_impl.h"

namespace lumifold::server {
namespace {

using job::JobId;

/// Minimum time between two statuses of a job sent to a client.
constexpr absl::Duration kWatchInterval = absl::Milliseconds(100);
/// Maximum time between two checks of the leases: options_.now may not be the clock that waits use.
constexpr absl::Duration kIdleInterval = absl::Seconds(1);

std::string_view EventOf(scheduler::Lateness lateness) {
  switch (lateness) {
    case scheduler::Lateness::kStalled:
      return "lease_stalled";
    case scheduler::Lateness::kOverdue:
      return "unit_overdue";
    default:
      return "lease_expired";
  }
}

}  // namespace

void Coordinator::RunFinisher() {
  while (true) {
    CommittedFrame frame;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &Coordinator::FinisherHasWork));
      if (stopping_) return;
      frame = std::move(committed_frames_.front());
      committed_frames_.pop_front();
      if (!active_jobs_.contains(frame.job)) continue;
    }
    const absl::StatusOr<v1::StageTimes> times = finisher_->Finish(frame.job, frame.number);
    if (absl::IsCancelled(times.status())) return;
    RecordFinished(frame, times);
  }
}

void Coordinator::RecordFinished(const CommittedFrame& frame, const absl::StatusOr<v1::StageTimes>& times) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(frame.job);
  if (active == active_jobs_.end()) return;
  if (absl::IsDataLoss(times.status()) || absl::IsNotFound(times.status())) {
    return committer_->Check(frame.job, frame.number, times.status());
  }
  if (!times.ok()) {
    EndJob(frame.job, v1::JOB_STATE_FAILED, std::string(times.status().message()));
    return;
  }
  v1::StageTimes& sum = active->second.times;
  v1::StageTimes recorded = *times;
  recorded.set_render_seconds(sum.render_seconds());
  if (absl::Status status = store_->RecordFrame(frame.job, frame.number, recorded); !status.ok()) {
    EndJob(frame.job, v1::JOB_STATE_FAILED, std::string(status.message()));
    return;
  }
  sum.set_assemble_seconds(sum.assemble_seconds() + times->assemble_seconds());
  sum.set_filter_seconds(sum.filter_seconds() + times->filter_seconds());
  sum.set_write_seconds(sum.write_seconds() + times->write_seconds());
  options_.log->info("event=frame_finished job={} frame={} filter_seconds={:.3f}", frame.job.value(),
                     frame.number, times->filter_seconds());
  changed_jobs_.insert(frame.job);
  housekeeping_.Signal();
  if (scheduler_.FrameFinished(frame.job, frame.number)) {
    EndJob(frame.job, v1::JOB_STATE_DONE, "");
  } else {
    committer_->Discard(frame.job, frame.number);
  }
}

void Coordinator::RunHousekeeping() {
  absl::MutexLock lock(&mutex_);
  while (!stopping_) {
    const absl::Duration pause = UntilNextHousekeeping();
    if (pause > absl::ZeroDuration()) housekeeping_.WaitWithTimeout(&mutex_, pause);
    if (stopping_) return;
    ExpireLeases();
    NotifyWatchers();
  }
}

absl::Duration Coordinator::UntilNextHousekeeping() {
  const absl::Time now = options_.now();
  absl::Duration pause = std::min(kIdleInterval, scheduler_.NextExpiry() - now);
  if (!changed_jobs_.empty()) pause = std::min(pause, watchers_notified_ + kWatchInterval - now);
  return pause;
}

void Coordinator::ExpireLeases() {
  const std::vector<scheduler::LateLease> late = scheduler_.ExpireLeases(options_.now());
  for (const scheduler::LateLease& lease : late) {
    options_.log->warn("event={} unit=\"{}\" worker={}", EventOf(lease.lateness), Describe(lease.unit),
                       NameOf(lease.worker));
    if (leasing_ && !lease.job_error.empty()) EndJob(lease.unit.job, v1::JOB_STATE_FAILED, lease.job_error);
  }
  GrantLeases();
}

void Coordinator::NotifyWatchers() {
  const absl::Time now = options_.now();
  if (changed_jobs_.empty() || now < watchers_notified_ + kWatchInterval) return;
  watchers_notified_ = now;
  for (const auto& [watcher, job] : watchers_) {
    if (!changed_jobs_.contains(job)) continue;
    const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
    if (status.ok()) watcher->OnStatus(*status);
  }
  changed_jobs_.clear();
}

}  // namespace lumifold::server
