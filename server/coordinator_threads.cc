// The coordinator's own threads: one finishes frames, one expires leases and notifies watchers.
#include <spdlog/logger.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
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

/// A frame that failed this often, of a cause that may go away, fails its job.
constexpr int kMaxFinishFailures = 3;
constexpr double kPauseGrowth = 4;

}  // namespace

void Coordinator::RunFinisher() {
  while (const std::optional<CommittedFrame> frame = NextCommittedFrame()) {
    const absl::StatusOr<v1::StageTimes> times = finisher_->Finish(frame->job, frame->number);
    if (!absl::IsCancelled(times.status())) RecordFinished(*frame, times);
  }
}

std::optional<Coordinator::CommittedFrame> Coordinator::NextCommittedFrame() {
  absl::MutexLock lock(&mutex_);
  while (true) {
    // The time limit is for frames that are not due: options_.now may not be the clock that waits use.
    while (!mutex_.AwaitWithTimeout(absl::Condition(this, &Coordinator::FinisherHasWork), kIdleInterval)) {
    }
    if (stopping_) return std::nullopt;
    const auto due = FindDueFrame();
    CommittedFrame frame = std::move(*due);
    committed_frames_.erase(due);
    if (active_jobs_.contains(frame.job)) return frame;
  }
}

std::deque<Coordinator::CommittedFrame>::iterator Coordinator::FindDueFrame() {
  const absl::Time now = options_.now();
  return std::find_if(committed_frames_.begin(), committed_frames_.end(),
                      [now](const CommittedFrame& frame) { return frame.not_before <= now; });
}

void Coordinator::RetryFrame(CommittedFrame frame, const absl::Status& error) {
  const std::string message(error.message());
  if (++frame.failures == kMaxFinishFailures) {
    EndJob(frame.job, v1::JOB_STATE_FAILED,
           absl::StrCat("frame ", frame.number, " failed ", frame.failures, " times: ", message));
    return;
  }
  const absl::Duration pause = options_.finish_pause * std::pow(kPauseGrowth, frame.failures - 1);
  options_.log->warn("event=frame_retried job={} frame={} failures={} pause_seconds={:.1f} error=\"{}\"",
                     frame.job.value(), frame.number, frame.failures, absl::ToDoubleSeconds(pause),
                     absl::Utf8SafeCEscape(message));
  frame.not_before = options_.now() + pause;
  committed_frames_.push_back(std::move(frame));
}

void Coordinator::RecordFinished(const CommittedFrame& frame, const absl::StatusOr<v1::StageTimes>& times) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(frame.job);
  if (active == active_jobs_.end()) return;
  if (absl::IsDataLoss(times.status()) || absl::IsNotFound(times.status())) {
    return committer_->Check(frame.job, frame.number, times.status());
  }
  if (IsWorthRetrying(times.status())) return RetryFrame(frame, times.status());
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
