#include "server/coordinator/job_status.h"

#include "server/job/job_state.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/job/frame_list.h"
#include "server/job/gaps.h"
#include "server/job/limits.h"
#include "server/job/plan.h"
#include "server/job/tile_grid.h"

namespace lumifold::server {
namespace {

/// What JobStatus::settings has of a spec.
v1::JobSpec SettingsOf(const v1::JobSpec& spec) {
  v1::JobSpec settings;
  settings.set_camera(spec.camera());
  settings.set_seed(spec.seed());
  settings.set_max_bounces(spec.max_bounces());
  *settings.mutable_filter() = spec.filter();
  settings.set_save_film(spec.save_film());
  if (spec.has_environment()) *settings.mutable_environment() = spec.environment();
  if (spec.has_lens()) *settings.mutable_lens() = spec.lens();
  settings.set_frames_per_second(spec.frames_per_second());
  if (spec.has_crop()) *settings.mutable_crop() = spec.crop();
  if (spec.has_pixel_filter()) *settings.mutable_pixel_filter() = spec.pixel_filter();
  settings.set_cryptomatte(spec.cryptomatte());
  settings.set_animation(spec.animation());
  settings.set_variant(spec.variant());
  settings.set_keep_dark(spec.keep_dark());
  settings.set_background(spec.background());
  settings.set_ground(spec.ground());
  *settings.mutable_planning() = spec.planning();
  return settings;
}

}  // namespace

v1::JobStatus StatusOfEndedJob(const ledger::JobRecord& record) {
  const v1::JobSpec& spec = record.spec;
  v1::JobStatus status;
  status.set_job_id(record.id.value());
  status.set_state(record.state);
  status.set_error(record.error);
  status.set_units_done(record.done.units);
  const bool is_divisible = spec.tile_size() > 0 && spec.pass_samples() > 0;  // a damaged spec may not be
  const int skipped = job::CountSkipped(record.scheduling.gaps());
  const int frames = job::FrameList(spec).count() - skipped;
  if (job::NeedsPlan(spec)) {
    status.set_units_total(1);
  } else {
    status.set_units_total(is_divisible ? job::FrameUnits(spec).count() * frames : 0);
  }
  status.set_frames_done(record.done.frames);
  status.set_frames_total(frames + skipped);
  status.set_frames_skipped(skipped);
  status.set_samples_done(record.done.samples);
  status.set_samples_total(int64_t{spec.width()} * spec.height() * spec.samples_per_pixel() * frames);
  if (spec.has_adaptive()) {  // how many it needs is known at its end
    status.set_units_total(record.done.units);
    if (job::IsDone(record.state)) status.set_samples_total(record.done.samples);
  } else if (job::IsDone(record.state)) {  // a ledger that was rebuilt has not counted them
    status.set_units_done(status.units_total());
    status.set_samples_done(status.samples_total());
  }
  status.set_bad_samples(record.done.bad_samples);
  for (const std::string& line : record.warnings) status.add_warnings(line);
  if (record.warnings_left_out > 0) {
    status.add_warnings(absl::StrCat(record.warnings_left_out,
                                     " further warnings of units are left out: a job keeps ",
                                     job::kMaxJobWarnings));
  }
  status.set_submitted_unix_ms(absl::ToUnixMillis(record.submitted));
  *status.mutable_times() = record.times;
  *status.mutable_scheduling() = record.scheduling;
  if (record.estimated_error.has_value()) status.set_estimated_error(*record.estimated_error);
  if (spec.has_adaptive()) *status.mutable_adaptive() = spec.adaptive();
  status.set_display_name(record.scheduling.name().empty() ? spec.scene().display_name()
                                                           : record.scheduling.name());
  status.set_width(spec.width());
  status.set_height(spec.height());
  status.set_samples_per_pixel(spec.samples_per_pixel());
  status.set_first_frame(spec.first_frame());
  status.set_frame_count(spec.frame_count());
  *status.mutable_more_frames() = spec.more_frames();
  *status.mutable_settings() = SettingsOf(spec);
  return status;
}

v1::JobStatus StatusOfRecord(const ledger::JobRecord& record) {
  v1::JobStatus status = StatusOfEndedJob(record);
  if (job::HasEnded(record.state)) return status;
  if (record.scheduling.paused()) {
    status.set_state(v1::JOB_STATE_PAUSED);
  } else if (record.done.units > 0) {
    status.set_state(v1::JOB_STATE_RUNNING);
  } else if (!job::NeedsPlan(record.spec)) {
    status.set_state(v1::JOB_STATE_PLANNED);
  }
  return status;
}

v1::JobState StateOfActiveJob(const ledger::JobRecord& record, const scheduler::JobProgress& progress,
                              bool waits) {
  if (waits) return v1::JOB_STATE_SUBMITTED;
  // The scheduler also pauses jobs that wait for an asset.
  if (progress.state != v1::JOB_STATE_PAUSED || record.scheduling.paused()) return progress.state;
  if (progress.units_done > 0) return v1::JOB_STATE_RUNNING;
  return job::NeedsPlan(record.spec) ? v1::JOB_STATE_SUBMITTED : v1::JOB_STATE_PLANNED;
}

v1::JobStatus StatusOfActiveJob(const ledger::JobRecord& record, const scheduler::JobProgress& progress,
                                bool waits) {
  v1::JobStatus status = StatusOfEndedJob(record);
  status.set_state(StateOfActiveJob(record, progress, waits));
  status.set_units_done(progress.units_done);
  status.set_units_total(progress.units_total);
  status.set_frames_done(progress.frames_done);
  status.set_samples_done(progress.samples_done);
  status.set_workers(progress.workers);
  return status;
}

void AddWarning(const std::string& line, ledger::JobRecord* record) {
  std::vector<std::string>& lines = record->warnings;
  if (std::find(lines.begin(), lines.end(), line) != lines.end()) return;
  if (lines.size() < size_t{job::kMaxJobWarnings}) {
    lines.push_back(line);
  } else {
    ++record->warnings_left_out;
  }
}

}  // namespace lumifold::server
