#include "server/coordinator/farm.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <utility>

#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/sandbox/sandbox.h"
#include "server/coordinator/farm_keeping.h"
#include "server/coordinator/job_status.h"
#include "server/job/frame_list.h"
#include "server/job/gaps.h"
#include "server/job/job_state.h"
#include "server/picture/make_picture.h"
#include "server/picture/picture_code.h"

namespace lumifold::server {
namespace {

/// Rays of a camera sample in common scenes: 6 to 20. Where that is wrong, the first estimate of a frame
/// travels in vain, or the coordinator makes it.
constexpr double kRaysOfSample = 10;

}  // namespace

using job::JobId;
using job::Prerequisite;

Farm::Farm(const Resources* resources, FarmEffects* effects)
    : scheduler({.lease = resources->options.workers.lease,
                 .disputes = {.deciding_parties = resources->options.workers.only_one
                                                      ? 1
                                                      : scheduler::DisputeOptions().deciding_parties},
                 .first_attempt = ledger::FirstAttempt(resources->owner.epoch)}),
      frames(resources->options.finishing),
      finish_leases(resources->options.workers.lease),
      frame_limit({.open_logs = resources->options.storage.max_open_logs,
                   .free_disk_bytes = resources->folder.FreeBytes().value_or(0),
                   .memory_bytes = sandbox::UsableMemoryBytes()}),
      resources_(resources),
      effects_(effects) {}

void Farm::StartJob(ledger::JobRecord record, const std::vector<Prerequisite>& after) {
  const JobId id = record.id;
  scheduler.jobs().Add(id, record.spec, scheduler::OptionsOf(record.scheduling));
  frames.AddJob(id, record.scheduling);
  resources_->log().info("event=job_submitted job={} scene={} size={}x{} spp={} frames={}", id.value(),
                         logging::Quoted(record.spec.scene().display_name()), record.spec.width(),
                         record.spec.height(), record.spec.samples_per_pixel(),
                         job::FrameList(record.spec).count());
  jobs.Activate(std::move(record));
  LimitFramesFor(id);
  AwaitPrerequisites(id, after);
}

void Farm::EnterJob(const LoadedJob& loaded) {
  const JobId id = loaded.record.id;
  ActiveJob* const active = jobs.Activate(loaded.record);
  if (!loaded.error.empty()) return FailJob(id, loaded.error);
  scheduler::JobOptions options = scheduler::OptionsOf(loaded.record.scheduling);
  // The plan binds the job to its class before any unit does.
  const std::string& planned_class = loaded.record.spec.plan().numeric_class();
  if (!planned_class.empty()) options.numeric_class = planned_class;
  if (!loaded.record.numeric_class.empty()) options.numeric_class = loaded.record.numeric_class;
  scheduler.jobs().Add(id, loaded.record.spec, options);
  frames.AddJob(id, loaded.record.scheduling);
  LimitFramesFor(id);
  for (const int32_t frame : loaded.finished) scheduler.frames().RestoreFinished(id, frame);
  for (const int32_t frame : job::SkippedFrames(loaded.record.scheduling.gaps()))
    scheduler.frames().Skip(id, frame);
  for (const auto& [frame, rounds] : loaded.rounds) {
    v1::StageTimes& times = active->record.times;  // the ledger has those of finished frames
    times.set_render_seconds(std::max(times.render_seconds(), rounds->rendered_seconds()));
    scheduler.frames().SetRounds(id, frame, rounds);
  }
  for (const scheduler::RestoredUnit& unit : loaded.units)
    scheduler.units().Restore(id, unit, resources_->options.now());
  for (const std::string& name : loaded.deliverers)
    scheduler.workers().AddWitness(PartyOf(name, /*is_certified=*/!resources_->options.insecure));
  for (const int32_t frame : scheduler.frames().Committed(id)) QueueDue({id, frame});
  for (const auto& [frame, rounds] : loaded.rounds) QueueDue({id, frame});
  const scheduler::JobProgress progress = scheduler.jobs().Progress(id);
  resources_->log().info("event=job_restored job={} units={}/{} frames={}/{}", id.value(),
                         progress.units_done, progress.units_total, progress.frames_done,
                         progress.frames_total);
  if (progress.state == v1::JOB_STATE_DONE) return EndJob(id, v1::JOB_STATE_DONE, "");
  // A job that has begun waited long enough, even if a job that it waited for runs again.
  const bool has_begun = progress.units_done > 0 || loaded.record.started != absl::InfinitePast();
  if (!has_begun) AwaitPrerequisites(id, loaded.after);
  watchers.MarkChanged(id);
}

void Farm::SetPlan(const job::UnitRef& unit, const v1::JobSpec& planned) {
  ActiveJob* const active = jobs.FindActive(unit.job);
  active->record.spec = planned;
  scheduler.units().SetPlan(unit, planned);
  for (const int32_t frame : job::SkippedFrames(active->record.scheduling.gaps()))
    scheduler.frames().Skip(unit.job, frame);
  LimitFramesFor(unit.job);
}

void Farm::EndJob(const JobId& job, v1::JobState state, const std::string& cause) {
  std::optional<ActiveJob> active = jobs.TakeActive(job);
  if (!active.has_value()) return;
  const std::string error = rpc::BoundedLine(cause, rpc::kMaxErrorBytes);
  if (state == v1::JOB_STATE_DONE && active->record.scheduling.gaps().skipped_size() > 0)
    state = v1::JOB_STATE_DONE_WITH_GAPS;
  EndingJob ending{.record = std::move(active->record), .shown = {}, .cancels = {}};
  if (scheduler.jobs().Has(job)) {
    const scheduler::JobProgress progress = scheduler.jobs().Progress(job);
    ending.shown = StatusOfActiveJob(ending.record, progress, dependencies.IsWaiting(job));
    // All frames may be finished, but the job is done when that is recorded.
    if (job::HasEnded(ending.shown.state())) ending.shown.set_state(v1::JOB_STATE_FILTERING);
    ending.record.done.units = progress.units_done;
    ending.record.done.samples = progress.samples_done;
    ending.record.done.frames = progress.frames_done;
  } else {  // its spec is not valid
    ending.shown = StatusOfEndedJob(ending.record);
  }
  ending.shown.set_workers(0);
  ending.record.state = state;
  ending.record.error = error;
  jobs.AddEnding(job, std::move(ending));
  StopRendering(job);
  effects_->RecordEnd(job, state, error);
  resources_->log().info("event=job_ended job={} state={} error={}", job.value(), v1::JobState_Name(state),
                         logging::Quoted(error));
}

void Farm::FailFrame(const FrameKey& frame, const std::string& cause) {
  const auto& [job, number] = frame;
  ActiveJob* const active = jobs.FindActive(job);
  if (active == nullptr) return;
  v1::Gaps* const gaps = active->record.scheduling.mutable_gaps();
  const scheduler::JobProgress progress = scheduler.jobs().Progress(job);
  const int skipped = progress.frames_skipped + static_cast<int>(active->skipping.size());
  const bool is_being_skipped = active->skipping.contains(number);
  if (is_being_skipped) return;
  if (gaps->skip_failed() && job::MaySkipAnother(skipped, progress.frames_done, progress.frames_total)) {
    active->skipping.insert(number);
    resources_->log().warn("event=frame_skipped job={} frame={} error={}", job.value(), number,
                           logging::Quoted(cause));
    return effects_->SkipFrame(frame, cause);
  }
  gaps->set_failed_frame(number);
  FailJob(job, cause);
}

void Farm::SuspendJob(const JobId& job, v1::JobStatus shown) {
  if (jobs.FindActive(job) != nullptr) {
    shown = StatusOf(job).value_or(shown);
    shown.set_workers(0);
    shown.clear_frames_filtering();
    shown.clear_frames_filtered();
    shown.clear_frames_waiting();
    jobs.TakeActive(job);
    dependencies.Remove(job);
    StopRendering(job);
  }
  jobs.Suspend(job, std::move(shown));
}

void Farm::StopRendering(const JobId& job) {
  scheduler.jobs().End(job);
  frames.ForgetJob(job);
  // JobEnded says so. A result that is being recorded ends by itself.
  for (const job::Attempt attempt : finish_leases.OfJob(job)) {
    if (!finish_leases.IsDelivered(attempt))
      frames.End(finish_leases.End(attempt).part, resources_->options.now());
  }
  effects_->CancelFinishing(job);
  workers.SendJobEnded(job);
}

void Farm::AwaitPrerequisites(const JobId& job, std::vector<Prerequisite> after) {
  if (after.empty()) return;
  for (Prerequisite& prerequisite : after) {
    // What is in memory is newer than what was read.
    if (jobs.IsInMemory(prerequisite.job)) prerequisite.state = v1::JOB_STATE_RUNNING;
  }
  const job::Settled settled = dependencies.Add(job, after);
  if (dependencies.IsWaiting(job)) {
    UpdatePause(job);
    effects_->KeepPrerequisites(dependencies.Named());
    return;
  }
  for (const job::HopelessJob& hopeless : settled.hopeless) FailJob(hopeless.job, hopeless.reason);
}

void Farm::Settle(const job::Settled& settled) {
  for (const JobId& job : settled.released) {
    if (jobs.FindActive(job) == nullptr) continue;
    UpdatePause(job);
    resources_->log().info("event=job_released job={}", job.value());
    watchers.MarkChanged(job);
  }
  for (const job::HopelessJob& job : settled.hopeless) FailJob(job.job, job.reason);
  if (settled.released.empty() && settled.hopeless.empty()) return;
  effects_->KeepPrerequisites(dependencies.Named());
}

void Farm::UpdatePause(const JobId& job) {
  const ActiveJob* const active = jobs.FindActive(job);
  if (active == nullptr) return;
  if (active->record.scheduling.paused() || dependencies.IsWaiting(job) || active->wanted_asset.has_value()) {
    scheduler.jobs().Pause(job);
  } else {
    scheduler.jobs().Resume(job);
  }
}

void Farm::OnAssetFound(const std::string& sha256) {
  for (const JobId& job : jobs.WaitingForAsset(sha256)) {
    jobs.FindActive(job)->wanted_asset.reset();
    resources_->log().info("event=asset_found job={} sha256={}", job.value(), sha256);
    UpdatePause(job);
    watchers.MarkChanged(job);
  }
}

std::optional<v1::JobStatus> Farm::StatusOf(const JobId& job) const {
  if (const ActiveJob* const active = jobs.FindActive(job); active != nullptr) {
    v1::JobStatus status =
        StatusOfActiveJob(active->record, scheduler.jobs().Progress(job), dependencies.IsWaiting(job));
    status.set_coordinator(address);
    const JobFrames counts = frames.CountsOf(job);
    status.set_frames_filtering(counts.running);
    status.set_frames_filtered(counts.filtered);
    status.set_frames_waiting(counts.waiting);
    if (active->predicted_error.has_value() && !status.has_estimated_error())
      status.set_estimated_error(*active->predicted_error);
    return status;
  }
  if (const SuspendedJob* const suspended = jobs.FindSuspended(job); suspended != nullptr)
    return suspended->shown;
  if (const EndingJob* const ending = jobs.FindEnding(job); ending != nullptr) return ending->shown;
  return std::nullopt;
}

int64_t Farm::LeasesWanted(const JobId& job) const {
  const ActiveJob* const active = jobs.FindActive(job);
  const bool may_run = active != nullptr && scheduler.jobs().Has(job) &&
                       !active->record.scheduling.paused() && !dependencies.IsWaiting(job) &&
                       !active->wanted_asset.has_value();
  if (!may_run) return 0;
  const scheduler::JobProgress progress = scheduler.jobs().Progress(job);
  const int64_t left = progress.units_total - progress.units_done;
  const int64_t limit = active->record.scheduling.max_leases();
  return limit > 0 ? std::min(left, limit) : left;
}

bool Farm::IsDue(const DueFrame& frame) const {
  if (frame.round == DueFrame::kResult) return scheduler.frames().IsCommitted(frame.job, frame.number);
  const std::shared_ptr<const job::FrameRounds> rounds = scheduler.frames().RoundsOf(frame.job, frame.number);
  return rounds != nullptr && !rounds->is_final() && rounds->estimated() == frame.round &&
         scheduler.frames().CommittedRounds(frame.job, frame.number) > frame.round;
}

void Farm::QueueDue(const FrameKey& key) {
  DueFrame frame = {.job = key.first, .number = key.second};
  if (!IsDue(frame)) {
    const std::shared_ptr<const job::FrameRounds> rounds =
        scheduler.frames().RoundsOf(frame.job, frame.number);
    if (rounds == nullptr) return;
    frame.round = rounds->estimated();
    if (!IsDue(frame)) return;
  }
  if (const ActiveJob* const active = jobs.FindActive(frame.job); active != nullptr) {
    frame.rendered = absl::Seconds(active->record.times.render_seconds());
    frame.memory_bytes = PictureMemoryOf(active->record.spec);
    const v1::JobSpec& spec = active->record.spec;
    const bool is_of_workers_too = SharesPictureCode(scheduler.jobs().NumericClassOf(frame.job),
                                                     resources_->options.finishing.other_bits);
    if (frame.round != DueFrame::kResult) {
      // What follows from an estimate is not compared: those of audited jobs are made here.
      frame.may_travel = is_of_workers_too && active->record.scheduling.audit_share() == 0 &&
                         scheduler.frames().RoundsOf(frame.job, frame.number)->NeedsPictureAt(kRaysOfSample);
    } else if (const int blocks = FrameBlocks(spec).count(); blocks == 1 || spec.has_adaptive()) {
      frame.may_travel = is_of_workers_too;
    } else if (is_of_workers_too) {
      frame.block_count = blocks;
    }
    frame.keeper = scheduler.keeping().KeeperOf(frame.job, frame.number);
  }
  frame.samples = scheduler.jobs().Progress(frame.job).samples_done;
  frames.Push(std::move(frame));
}

void Farm::LimitFrames(uint64_t free_disk_bytes) {
  frame_limit.Reset(free_disk_bytes);
  for (const auto& [job, active] : jobs.active()) {
    if (scheduler.jobs().Has(job)) LimitFramesFor(job);
  }
}

void Farm::LimitFramesFor(const JobId& job) {
  frame_limit.Add(DemandOf(scheduler.jobs().SpecOf(job), scheduler.jobs().UnitsOf(job),
                           jobs.FindActive(job)->unit_bytes));
  scheduler.frames().SetMaxActive(frame_limit.MaxActiveFrames());
}

void Farm::CountCommitted(const AcceptedUnit& unit) {
  ++totals.units_committed;
  totals.samples_committed += unit.samples;
  const job::UnitRef& ref = unit.stored.unit;
  history.AddUnit(unit.worker_name, ref.job, ref.key.frame, unit.accepted,
                  absl::Seconds(unit.stored.stats.seconds()));
  ActiveJob* const active = jobs.FindActive(ref.job);
  if (active == nullptr) {  // the job ended while the unit was being committed
    EndingJob* const ending = jobs.FindEnding(ref.job);
    if (ending == nullptr) return;
    ++ending->record.done.units;
    ending->record.done.samples += unit.samples;
    ending->record.done.bad_samples += unit.stored.stats.bad_samples();
    return;
  }
  ledger::JobRecord& record = active->record;
  record.done.bad_samples += unit.stored.stats.bad_samples();
  if (unit.record_bytes > 0) {  // otherwise its worker keeps it
    active->unit_bytes.bytes += unit.record_bytes;
    ++active->unit_bytes.units;
    LetKeep(*resources_, ref.job, this);
  }
  if (active->render_start.has_value())
    record.times.set_render_seconds(absl::ToDoubleSeconds(resources_->options.now() - *active->render_start));
  for (const std::string& line : unit.stored.stats.warnings()) AddWarning(line, &record);
  resources_->log().debug("event=unit_committed unit={} worker={} seconds={:.3f}",
                          logging::Quoted(Describe(ref)), workers.NameOf(unit.worker),
                          unit.stored.stats.seconds());
  if (scheduler.units().Commit(ref))
    resources_->log().info("event=frame_committed job={} frame={}", ref.job.value(), ref.key.frame);
  QueueDue({ref.job, ref.key.frame});
  watchers.MarkChanged(ref.job);
}

void Farm::RevokeUnits(const JobId& job, const std::vector<ledger::UnitRecord>& units) {
  for (const ledger::UnitRecord& record : units) {
    scheduler.units().Revoke(record.unit);
    jobs.FindActive(job)->record.done.bad_samples -= record.bad_samples;
  }
  watchers.MarkChanged(job);
}

}  // namespace lumifold::server
