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
#include "absl/strings/str_format.h"
#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"
#include "server/coordinator/frame_limit.h"

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
    case scheduler::Lateness::kDropped:
      return "lease_dropped";
    default:
      return "lease_expired";
  }
}

/// A frame that failed this often, of a cause that may go away, fails its job.
constexpr int kMaxFinishFailures = 3;
constexpr double kPauseGrowth = 4;
/// Longest pause before a frame that found the disk full is tried again, and the growths that lead to it at most.
constexpr absl::Duration kLongestFinishPause = absl::Minutes(1);
constexpr int kMaxGrowths = 20;

}  // namespace

void Coordinator::RunFinisher() {
  while (const std::optional<CommittedFrame> frame = NextCommittedFrame()) {
    const bool is_result = frame->round == CommittedFrame::kResult;
    const absl::StatusOr<v1::FrameReport> report =
        is_result ? finisher_->Finish(Owned(frame->job), frame->number)
                  : finisher_->Estimate({frame->job, owner_.epoch, frame->number, frame->round,
                                         frame->rendered, frame->samples});
    // Aborted: another coordinator has taken the job over, and finishes the frame.
    const bool is_dropped = absl::IsCancelled(report.status()) || absl::IsAborted(report.status());
    if (!is_dropped) RecordFinished(*frame, report);
    absl::MutexLock lock(&mutex_);
    finished_frame_.reset();
  }
}

std::optional<Coordinator::CommittedFrame> Coordinator::NextCommittedFrame() {
  while (true) {
    absl::Duration pause = kIdleInterval;
    {
      absl::MutexLock lock(&mutex_);
      if (stopping_) return std::nullopt;
      if (const auto due = FindDueFrame(); due != committed_frames_.end()) {
        CommittedFrame frame = std::move(*due);
        committed_frames_.erase(due);
        if (!active_jobs_.contains(frame.job) || !IsDue(frame)) continue;
        finished_frame_ = frame.key();
        finished_in_vain_ = false;
        return frame;
      }
      // Of frames that are due already, only the storage is waited for: its return wakes this thread.
      const absl::Time now = options_.now();
      for (const CommittedFrame& frame : committed_frames_) {
        if (frame.not_before > now) pause = std::min(pause, frame.not_before - now);
      }
    }
    finishing_.Consume(pause);
  }
}

std::deque<Coordinator::CommittedFrame>::iterator Coordinator::FindDueFrame() {
  if (!storage_.ok()) return committed_frames_.end();
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
  options_.log->warn("event=frame_retried job={} frame={} failures={} pause_seconds={:.1f} error={}",
                     frame.job.value(), frame.number, frame.failures, absl::ToDoubleSeconds(pause),
                     logging::Quoted(message));
  frame.not_before = options_.now() + pause;
  committed_frames_.push_back(std::move(frame));
}

void Coordinator::AwaitStorage(CommittedFrame frame, const absl::Status& error) {
  const absl::Duration pause =
      std::min(kLongestFinishPause,
               options_.finish_pause * std::pow(kPauseGrowth, std::min(frame.waits, kMaxGrowths)));
  ++frame.waits;
  options_.log->warn("event=frame_waits job={} frame={} pause_seconds={:.1f} error={}", frame.job.value(),
                     frame.number, absl::ToDoubleSeconds(pause),
                     logging::Quoted(std::string(error.message())));
  frame.not_before = options_.now() + pause;
  committed_frames_.push_back(std::move(frame));
}

void Coordinator::RecordFinished(const CommittedFrame& frame, const absl::StatusOr<v1::FrameReport>& report) {
  if (absl::IsUnavailable(report.status())) storage_.Fail(report.status());
  if (report.ok() && frame.round != CommittedFrame::kResult) return OnRoundEstimated(frame, *report);
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(frame.job);
  if (active == active_jobs_.end()) return;
  const FrameKey key = frame.key();
  if (finished_in_vain_ || !IsDue(frame)) return;  // it is queued again when its units are committed again
  if (absl::IsDataLoss(report.status()) || absl::IsNotFound(report.status()))
    return committer_->Check(key, report.status());
  if (absl::IsUnavailable(report.status())) return AwaitStorage(frame, report.status());
  if (IsWorthRetrying(report.status())) return RetryFrame(frame, report.status());
  if (!report.ok()) {
    EndJob(frame.job, v1::JOB_STATE_FAILED, std::string(report.status().message()));
    return;
  }
  v1::FrameReport recorded = *report;
  recorded.mutable_times()->set_render_seconds(active->second.times.render_seconds());
  committer_->Write(
      [this, key, recorded] { return store_->RecordFrame(Owned(key.first), key.second, recorded); },
      [this, frame, recorded](const absl::Status& status) { OnFrameRecorded(frame, recorded, status); });
}

void Coordinator::OnFrameRecorded(const CommittedFrame& frame, const v1::FrameReport& report,
                                  const absl::Status& status) {
  const JobId& job = frame.job;
  if (status.ok()) {
    committer_->ForgetLog({job, frame.number});
    janitor_.FrameFinished(job, frame.number);
    PurgeUnits();
  }
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(job);
  if (active == active_jobs_.end()) return;
  if (!status.ok()) return EndJob(job, v1::JOB_STATE_FAILED, std::string(status.message()));
  const v1::StageTimes& times = report.times();
  v1::StageTimes& sum = active->second.times;
  sum.set_assemble_seconds(sum.assemble_seconds() + times.assemble_seconds());
  sum.set_filter_seconds(sum.filter_seconds() + times.filter_seconds());
  sum.set_write_seconds(sum.write_seconds() + times.write_seconds());
  timings_.ObserveFrame(times);
  std::string error;
  if (report.has_estimated_error()) {
    active->second.NoteError(report.estimated_error());
    error = absl::StrFormat(" estimated_error=%.4g", report.estimated_error());
  }
  options_.log->info("event=frame_finished job={} frame={} filter_seconds={:.3f}{}", job.value(),
                     frame.number, times.filter_seconds(), error);
  changed_jobs_.insert(job);
  housekeeping_.Notify();
  if (scheduler_.FrameFinished(job, frame.number)) {
    EndJob(job, v1::JOB_STATE_DONE, "");
  } else {
    GrantLeases();  // another frame may be active now
  }
}

void Coordinator::RunHousekeeping() {
  while (true) {
    janitor_.Poke();
    absl::Duration pause;
    const uint64_t free_bytes = folder_.FreeBytes().value_or(0);
    {
      absl::MutexLock lock(&mutex_);
      if (stopping_) return;
      LimitFrames(free_bytes);
      ExpireLeases();
      NotifyWatchers();
      pause = UntilNextHousekeeping();
    }
    if (pause > absl::ZeroDuration()) housekeeping_.Consume(pause);
  }
}

void Coordinator::LimitFrames(uint64_t free_disk_bytes) {
  frame_resources_.free_disk_bytes = free_disk_bytes;
  largest_frame_ = {};
  for (const auto& [job, record] : active_jobs_) {
    if (scheduler_.HasJob(job)) LimitFramesFor(job);
  }
}

void Coordinator::LimitFramesFor(const JobId& job) {
  const FrameDemand demand = DemandOf(scheduler_.SpecOf(job), scheduler_.UnitsOf(job), unit_bytes_[job]);
  largest_frame_.log_bytes = std::max(largest_frame_.log_bytes, demand.log_bytes);
  largest_frame_.units = std::max(largest_frame_.units, demand.units);
  scheduler_.SetMaxActiveFrames(MaxActiveFrames(frame_resources_, largest_frame_));
}

absl::Duration Coordinator::UntilNextHousekeeping() {
  const absl::Time now = options_.now();
  absl::Duration pause = std::min(kIdleInterval, scheduler_.NextExpiry() - now);
  if (!changed_jobs_.empty()) pause = std::min(pause, watchers_notified_ + kWatchInterval - now);
  return pause;
}

void Coordinator::ExpireLeases() {
  ReportLate(scheduler_.ExpireLeases(options_.now()));
  GrantLeases();
}

void Coordinator::ReportLate(const std::vector<scheduler::LateLease>& late) {
  for (const scheduler::LateLease& lease : late) {
    options_.log->warn("event={} unit={} worker={}", EventOf(lease.lateness),
                       logging::Quoted(Describe(lease.unit)), NameOf(lease.worker));
    if (leasing_ && !lease.job_error.empty()) EndJob(lease.unit.job, v1::JOB_STATE_FAILED, lease.job_error);
  }
}

void Coordinator::NotifyWatchers() {
  const absl::Time now = options_.now();
  if (changed_jobs_.empty() || now < watchers_notified_ + kWatchInterval) return;
  watchers_notified_ = now;
  for (const auto& [watcher, job] : watchers_) {
    if (!changed_jobs_.contains(job)) continue;
    if (const std::optional<v1::JobStatus> status = StatusInMemory(job)) watcher->OnStatus(*status);
  }
  changed_jobs_.clear();
}

}  // namespace lumifold::server
