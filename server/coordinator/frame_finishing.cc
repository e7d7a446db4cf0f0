#include "server/coordinator/frame_finishing.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/logging/fields.h"
#include "proto/rpc/sha256.h"
#include "proto/threads/event.h"
#include "server/film/result_digest.h"
#include "server/finish/estimate_round.h"
#include "server/finish/frame_finisher.h"

namespace lumifold::server {
namespace {

using job::JobId;

/// Maximum time between two looks at the queue: options.now may not be the clock that waits use.
constexpr absl::Duration kIdleInterval = absl::Seconds(1);

}  // namespace

std::string PathOf(const DataFolder& folder, const FramePart& part) {
  const auto& [job, number] = part.frame;
  if (part.IsBlock()) return folder.BlockPath(job, number, part.block);
  return part.IsEstimate() ? ErrorsPath(folder, job, number, part.round) : folder.ResultPath(job, number);
}

std::optional<double> EstimatedErrorOf(const v1::FrameReport& report) {
  return report.has_estimated_error() ? std::optional(report.estimated_error()) : std::nullopt;
}

FrameFinishing::FrameFinishing(Resources* resources, FarmState* state, Committer* committer, Cleanup* cleanup,
                               threads::Event* wake_up)
    : resources_(resources), state_(state), committer_(committer), cleanup_(cleanup), wake_up_(wake_up) {}

void FrameFinishing::Start() {
  thread_ = std::thread([this] { Run(); });
}

void FrameFinishing::Join() {
  if (thread_.joinable()) thread_.join();
}

double FrameFinishing::SumOf(const v1::StageTimes& times) {
  return times.assemble_seconds() + times.filter_seconds() + times.write_seconds();
}

void FrameFinishing::Run() {
  while (const std::optional<RunningFrame> frame = Next()) {
    Running& running = running_.emplace_back();
    running.thread = std::thread([this, frame = *frame, &running] {
      FinishFrame(frame);
      running.has_ended.Notify();
    });
  }
  for (Running& running : running_) running.thread.join();
}

absl::StatusOr<v1::FrameReport> FrameFinishing::RunFinisher(const RunningFrame& frame) {
  FrameFinisher* const finisher = resources_->finisher;
  const DueFrame& due = frame.due;
  const ledger::OwnedJob job = resources_->Owned(due.job);
  if (frame.part().IsBlock()) return finisher->Filter(job, due.number, frame.block, frame.threads);
  if (frame.part().IsResult()) {
    return finisher->Finish(job, due.number, frame.threads, due.blocks.done, [&](double share) {
      FarmState::Change farm(state_);
      if (farm->frames.SetFiltered(frame.part(), share)) farm->watchers.MarkChanged(due.job);
    });
  }
  return finisher->Estimate(
      {due.job, job.epoch, due.number, due.round, due.rendered, due.samples,
       due.blocks.done.empty() ? std::nullopt : std::optional(absl::Seconds(due.blocks.seconds))},
      frame.threads);
}

void FrameFinishing::FinishFrame(const RunningFrame& frame) {
  const DueFrame& due = frame.due;
  absl::StatusOr<v1::FrameReport> report = RunFinisher(frame);
  if (report.ok()) JudgeClaims(frame, *report);
  if (frame.part().IsBlock()) return OnBlock(frame.part(), frame.threads, report);
  // Aborted: another coordinator has taken the job over, and finishes the frame.
  const bool is_dropped = absl::IsCancelled(report.status()) || absl::IsAborted(report.status());
  if (report.ok()) report->set_core_seconds(due.blocks.seconds + frame.threads * SumOf(report->times()));
  if (!is_dropped) OnFinished(due, report);
  if (report.ok()) {
    for (const int block : due.blocks.done)
      resources_->folder.files()->Remove(PathOf(resources_->folder, {due.key(), block, due.round}));
  }
  FarmState::Change(state_)->frames.End(frame.part(), resources_->options.now());
}

void FrameFinishing::OnBlock(const FramePart& block, int threads,
                             const absl::StatusOr<v1::FrameReport>& report) {
  if (absl::IsUnavailable(report.status())) resources_->storage.Fail(report.status());
  FarmState::Change farm(state_);
  if (report.ok())
    return farm->frames.End(block, resources_->options.now(), threads * SumOf(report->times()));
  resources_->log().warn("event=frame_came_back unit={} worker=- reason={}",
                         logging::Quoted(Describe(UnitOf(block))),
                         logging::Quoted(report.status().message()));
  farm->frames.ComeBack(block, resources_->options.now());
}

void FrameFinishing::JudgeClaims(const RunningFrame& running, const v1::FrameReport& report) {
  const DueFrame& frame = running.due;
  if (frame.claims.empty()) return;
  const std::string path = PathOf(resources_->folder, running.part());
  const absl::StatusOr<std::string> digest =
      running.part().IsBlock() ? rpc::Sha256HexOfFile(path) : film::ResultDigest(path);
  if (!digest.ok()) return;  // nothing to compare with
  const ClaimedResult made = {.worker = "", .sha256 = *digest, .estimated_error = EstimatedErrorOf(report)};
  FarmState::Change farm(state_);
  if (farm->frames.IsStale(frame.key())) return;
  for (const ClaimedResult& claim : frame.claims) {
    if (claim.Confirms(made)) continue;
    farm->scheduler.BlockFaulty(
        claim.worker, absl::StrCat("it delivered another picture of ", Describe(UnitOf(running.part())),
                                   " than this coordinator has made"));
  }
}

void FrameFinishing::JoinEnded() {
  for (auto running = running_.begin(); running != running_.end();) {
    const bool has_ended = running->has_ended.HasBeenNotified();
    if (has_ended) running->thread.join();
    running = has_ended ? running_.erase(running) : std::next(running);
  }
}

std::optional<RunningFrame> FrameFinishing::Next() {
  while (true) {
    JoinEnded();
    absl::Duration pause = kIdleInterval;
    std::optional<RunningFrame> frame = Begin(&pause);
    if (frame.has_value()) return frame;
    if (FarmState::View(state_)->is_stopping()) return std::nullopt;
    wake_up_->Consume(pause);
  }
}

std::optional<RunningFrame> FrameFinishing::Begin(absl::Duration* pause) {
  const absl::Time now = resources_->options.now();
  FarmState::Change farm(state_);
  if (farm->is_stopping()) return std::nullopt;
  if (resources_->storage.ok()) {
    while (std::optional<RunningFrame> frame = farm->BeginFrame(now)) {
      if (!frame->worker.has_value()) return frame;
    }
  }
  // Of frames that are due already, only room and the storage are waited for: both wake this thread.
  *pause = std::min(*pause, farm->frames.NextDue(now) - now);
  return std::nullopt;
}

void FrameFinishing::RetryFrame(Farm* farm, DueFrame frame, const absl::Status& error) {
  const absl::Time now = resources_->options.now();
  if (!farm->frames.Retry(&frame, now)) {
    return farm->FailFrame(frame.key(), absl::StrCat("frame ", frame.number, " failed ", frame.failures,
                                                     " times: ", std::string(error.message())));
  }
  resources_->log().warn("event=frame_retried job={} frame={} failures={} pause_seconds={:.1f} error={}",
                         frame.job.value(), frame.number, frame.failures,
                         absl::ToDoubleSeconds(frame.not_before - now), logging::Quoted(error.message()));
}

void FrameFinishing::AwaitStorage(Farm* farm, DueFrame frame, const absl::Status& error) {
  const absl::Time now = resources_->options.now();
  farm->frames.AwaitStorage(&frame, now);
  resources_->log().warn("event=frame_waits job={} frame={} pause_seconds={:.1f} error={}", frame.job.value(),
                         frame.number, absl::ToDoubleSeconds(frame.not_before - now),
                         logging::Quoted(error.message()));
}

void FrameFinishing::OnFinished(DueFrame frame, const absl::StatusOr<v1::FrameReport>& report) {
  if (absl::IsUnavailable(report.status())) resources_->storage.Fail(report.status());
  if (report.ok() && frame.round != DueFrame::kResult) return OnRoundEstimated(frame, *report);
  FarmState::Change farm(state_);
  const ActiveJob* const active = farm->jobs.FindActive(frame.job);
  if (active == nullptr) return;
  // A stale one is queued again when its units are committed again.
  if (farm->frames.IsStale(frame.key()) || !farm->IsDue(frame)) return;
  if (!report.ok() && frame.kept != nullptr) {  // its worker has dropped them by now
    resources_->log().warn("event=frame_kept_no_more job={} frame={} units={} reason={}", frame.job.value(),
                           frame.number, frame.kept->units.size(),
                           logging::Quoted(report.status().message()));
    return farm->RevokeUnits(frame.job, frame.kept->units);
  }
  if (absl::IsDataLoss(report.status()) || absl::IsNotFound(report.status()))
    return committer_->Check(frame.key(), report.status());
  if (absl::IsUnavailable(report.status())) return AwaitStorage(&*farm, std::move(frame), report.status());
  if (IsWorthRetrying(report.status())) return RetryFrame(&*farm, std::move(frame), report.status());
  if (!report.ok()) return farm->FailFrame(frame.key(), std::string(report.status().message()));
  v1::FrameReport recorded = *report;
  recorded.set_finished_unix_ms(absl::ToUnixMillis(resources_->options.wall_now()));
  recorded.mutable_times()->set_render_seconds(active->record.times.render_seconds());
  committer_->Write(
      [this, key = frame.key(), kept = frame.kept, recorded] {
        return kept != nullptr
                   ? resources_->store->RecordKeptFrame(*kept, key.second, recorded)
                   : resources_->store->RecordFrame(resources_->Owned(key.first), key.second, recorded);
      },
      [this, frame, recorded](const absl::Status& status) { OnFrameRecorded(frame, recorded, status); });
}

void FrameFinishing::OnRoundEstimated(const DueFrame& frame, const v1::FrameReport& report) {
  v1::JobSpec spec;
  {
    FarmState::View farm(state_);
    const ActiveJob* const active = farm->jobs.FindActive(frame.job);
    if (active == nullptr) return;
    spec = active->record.spec;
  }
  absl::StatusOr<job::FrameRounds> rounds = ReadRounds(resources_->folder, frame.job, spec, frame.number);
  FarmState::Change farm(state_);
  ActiveJob* const active = farm->jobs.FindActive(frame.job);
  if (active == nullptr) return;
  if (!rounds.ok()) return farm->FailJob(frame.job, std::string(rounds.status().message()));
  resources_->log().info(
      "event=round_estimated job={} frame={} round={} rounds={} final={} error={:.4g} seconds={:.3f}",
      frame.job.value(), frame.number, frame.round, rounds->count(), rounds->is_final(),
      rounds->predicted_error(), report.times().filter_seconds());
  if (rounds->predicted_error() >= 0) active->predicted_error = rounds->predicted_error();
  farm->scheduler.frames().SetRounds(frame.job, frame.number,
                                     std::make_shared<const job::FrameRounds>(*std::move(rounds)));
  farm->QueueDue(frame.key());
  farm->watchers.MarkChanged(frame.job);
}

void FrameFinishing::OnFrameRecorded(const DueFrame& frame, const v1::FrameReport& report,
                                     const absl::Status& status) {
  const JobId& job = frame.job;
  if (status.ok()) {
    committer_->ForgetLog(frame.key());
    cleanup_->janitor().FrameFinished(job, frame.number);
    cleanup_->PurgeUnits();
  }
  FarmState::Change farm(state_);
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (active == nullptr) return;
  if (!status.ok()) return farm->FailJob(job, std::string(status.message()));
  const v1::StageTimes& times = report.times();
  v1::StageTimes& sum = active->record.times;
  sum.set_assemble_seconds(sum.assemble_seconds() + times.assemble_seconds());
  sum.set_filter_seconds(sum.filter_seconds() + times.filter_seconds());
  sum.set_write_seconds(sum.write_seconds() + times.write_seconds());
  resources_->timings.ObserveFrame(times);
  std::string error;
  if (report.has_estimated_error()) {
    active->record.NoteError(report.estimated_error());
    error = absl::StrFormat(" estimated_error=%.4g", report.estimated_error());
  }
  resources_->log().info("event=frame_finished job={} frame={} filter_seconds={:.3f}{}", job.value(),
                         frame.number, times.filter_seconds(), error);
  farm->watchers.MarkChanged(job);
  if (farm->scheduler.frames().Finish(job, frame.number)) farm->EndJob(job, v1::JOB_STATE_DONE, "");
}

}  // namespace lumifold::server
