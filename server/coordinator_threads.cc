// The coordinator's own threads: frames are finished on one, time passes on the other.
#include <spdlog/logger.h>

#include <algorithm>

#include "server/coordinator_impl.h"

namespace lumifold::server {
namespace {

using scheduler::JobId;

/// Clients hear of a job at most ten times a second.
constexpr absl::Duration kWatchInterval = absl::Milliseconds(100);
/// Leases are looked at this often at least: the clock may be another than the one the wait goes by.
constexpr absl::Duration kIdleInterval = absl::Seconds(1);

}  // namespace

void Coordinator::RunFinisher() {
  while (true) {
    MergedFrame merged;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &Coordinator::FinisherHasWork));
      if (stopping_) return;
      merged = std::move(merged_frames_.front());
      merged_frames_.pop_front();
      if (!active_jobs_.contains(merged.job)) continue;
    }
    const absl::StatusOr<v1::StageTimes> times = finisher_->Finish(merged.job, merged.frame);
    if (absl::IsCancelled(times.status())) return;
    RecordFinished(merged, times);
  }
}

void Coordinator::RecordFinished(const MergedFrame& merged, const absl::StatusOr<v1::StageTimes>& times) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(merged.job);
  if (active == active_jobs_.end()) return;
  if (!times.ok()) {
    EndJob(merged.job, v1::JOB_STATE_FAILED, std::string(times.status().message()));
    return;
  }
  v1::StageTimes& sum = active->second.times;
  v1::StageTimes recorded = *times;
  recorded.set_render_seconds(sum.render_seconds());
  if (absl::Status status = store_->RecordFrame(merged.job, merged.frame, recorded); !status.ok()) {
    EndJob(merged.job, v1::JOB_STATE_FAILED, std::string(status.message()));
    return;
  }
  sum.set_assemble_seconds(sum.assemble_seconds() + times->assemble_seconds());
  sum.set_filter_seconds(sum.filter_seconds() + times->filter_seconds());
  sum.set_write_seconds(sum.write_seconds() + times->write_seconds());
  options_.log->info("event=frame_finished job={} frame={} filter_seconds={:.3f}", merged.job.value(),
                     merged.frame, times->filter_seconds());
  changed_jobs_.insert(merged.job);
  chores_.Signal();
  if (scheduler_.FrameFinished(merged.job, merged.frame)) {
    EndJob(merged.job, v1::JOB_STATE_DONE, "");
  } else {
    committer_->Discard(merged.job, merged.frame);
  }
}

void Coordinator::RunHousekeeping() {
  absl::MutexLock lock(&mutex_);
  while (!stopping_) {
    const absl::Duration pause = UntilNextChore();
    if (pause > absl::ZeroDuration()) chores_.WaitWithTimeout(&mutex_, pause);
    if (stopping_) return;
    ExpireLeases();
    TellWatchers();
  }
}

absl::Duration Coordinator::UntilNextChore() {
  const absl::Time now = options_.now();
  absl::Duration pause = std::min(kIdleInterval, scheduler_.NextExpiry() - now);
  if (!changed_jobs_.empty()) pause = std::min(pause, watchers_told_ + kWatchInterval - now);
  return pause;
}

void Coordinator::ExpireLeases() {
  const std::vector<scheduler::ExpiredLease> expired = scheduler_.ExpireLeases(options_.now());
  for (const scheduler::ExpiredLease& lease : expired) {
    options_.log->warn("event=lease_expired unit=\"{}\" worker={}", Describe(lease.unit),
                       NameOf(lease.worker));
  }
  if (!expired.empty()) GrantToAll();
}

void Coordinator::TellWatchers() {
  const absl::Time now = options_.now();
  if (changed_jobs_.empty() || now < watchers_told_ + kWatchInterval) return;
  watchers_told_ = now;
  for (const auto& [watcher, job] : watchers_) {
    if (!changed_jobs_.contains(job)) continue;
    const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
    if (status.ok()) watcher->OnStatus(*status);
  }
  changed_jobs_.clear();
}

}  // namespace lumifold::server
