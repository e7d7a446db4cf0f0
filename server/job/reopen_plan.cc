#include "server/job/reopen_plan.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "server/job/gaps.h"
#include "server/job/job_spec.h"
#include "server/job/job_state.h"
#include "server/job/limits.h"

namespace lumifold::job {
namespace {

absl::StatusOr<v1::JobSpec> SpecWith(const v1::JobSpec& spec, std::optional<int> samples_per_pixel) {
  if (!samples_per_pixel.has_value()) return spec;
  if (*samples_per_pixel < spec.samples_per_pixel()) {
    return absl::InvalidArgumentError(absl::StrCat("samples_per_pixel is ", *samples_per_pixel,
                                                   ", but the job has ", spec.samples_per_pixel(),
                                                   " already"));
  }
  if (spec.has_adaptive() && *samples_per_pixel != spec.samples_per_pixel())
    return absl::InvalidArgumentError(
        "a job with adaptive sampling cannot get other samples: submit it again");
  v1::JobSpec more = spec;
  more.set_samples_per_pixel(*samples_per_pixel);
  return NormaliseJobSpec(std::move(more));
}

absl::StatusOr<std::set<int32_t>> FramesNamed(const ReopenedJob& job, const std::vector<int32_t>& named) {
  if (named.empty()) return std::set<int32_t>(job.frames.begin(), job.frames.end());
  for (const int32_t frame : named) {
    if (!std::binary_search(job.frames.begin(), job.frames.end(), frame))
      return absl::InvalidArgumentError(absl::StrCat("frames: the job has no frame ", frame));
  }
  return std::set<int32_t>(named.begin(), named.end());
}

absl::StatusOr<std::set<int32_t>> TilesNamed(const v1::JobSpec& spec, const Rect& region) {
  const Rect within = Intersect(region, {0, 0, spec.width(), spec.height()});
  if (region.IsEmpty() || within.IsEmpty()) {
    return absl::InvalidArgumentError(absl::StrCat("region: ", region.x0, ",", region.y0, " to ", region.x1,
                                                   ",", region.y1, " has no pixel of the ", spec.width(), "x",
                                                   spec.height(), " picture"));
  }
  const std::vector<int32_t> tiles = FrameUnits(spec).tiles().TilesIn(within);
  return std::set<int32_t>(tiles.begin(), tiles.end());
}

}  // namespace

ReopenPlan::ReopenPlan(const v1::JobSpec& before, v1::JobSpec spec)
    : spec_(std::move(spec)), before_(before), after_(spec_) {}

absl::StatusOr<ReopenPlan> ReopenPlan::Make(const ReopenedJob& job, const ReopenRequest& request) {
  absl::StatusOr<v1::JobSpec> spec = SpecWith(job.spec, request.samples_per_pixel);
  if (!spec.ok()) return spec.status();
  ReopenPlan plan(job.spec, *std::move(spec));
  absl::StatusOr<std::set<int32_t>> named = FramesNamed(job, request.frames);
  if (!named.ok()) return named.status();
  if (request.skip && (request.region.has_value() || request.filter_only))
    return absl::InvalidArgumentError("skip: not together with region or filter_only");
  if (request.skip && IsDone(job.state)) return plan;  // all that it does not skip is finished
  if (request.region.has_value()) {
    absl::StatusOr<std::set<int32_t>> tiles = TilesNamed(job.spec, *request.region);
    if (!tiles.ok()) return tiles.status();
    plan.again_tiles_ = *std::move(tiles);
  }
  const bool names_parts = !request.frames.empty() || request.region.has_value() || request.filter_only;
  const bool is_incomplete = HasEnded(job.state) && job.state != v1::JOB_STATE_DONE;
  const bool adds_samples = request.samples_per_pixel.has_value();
  if (adds_samples && *request.samples_per_pixel == job.spec.samples_per_pixel()) return plan;
  if (!adds_samples && !names_parts && !request.skip && !HasEnded(job.state)) return plan;
  const bool goes_on = request.skip || (!adds_samples && !names_parts && is_incomplete);
  if (absl::Status status = plan.PlanGaps(job, request, *named, goes_on); !status.ok()) return status;
  if (request.skip && !plan.changes_gaps_ && !HasEnded(job.state)) return plan;
  if (goes_on) named->clear();
  if (!adds_samples && !request.filter_only) plan.again_frames_ = *named;
  plan.PlanFrames(job, request, *named);
  return plan;
}

absl::Status ReopenPlan::PlanGaps(const ReopenedJob& job, const ReopenRequest& request,
                                  const std::set<int32_t>& named, bool goes_on) {
  gaps_ = job.gaps;
  gaps_.clear_failed_frame();
  const std::vector<int32_t> before = SkippedFrames(job.gaps);
  std::set<int32_t> skipped(before.begin(), before.end());
  if (request.skip && request.frames.empty()) {
    gaps_.set_skip_failed(true);
    if (job.gaps.has_failed_frame()) skipped.insert(job.gaps.failed_frame());
  } else if (request.skip) {
    skipped.insert(named.begin(), named.end());
  } else if (goes_on) {
    skipped.clear();
    gaps_.set_skip_failed(false);
  } else if (!request.frames.empty()) {
    std::erase_if(skipped, [&](int32_t frame) { return named.contains(frame); });
  }
  std::erase_if(skipped, [&](int32_t frame) {
    return std::binary_search(job.finished.begin(), job.finished.end(), frame);
  });
  if (request.skip && skipped.size() == job.frames.size())
    return absl::InvalidArgumentError("skip: the job would have no frame; cancel it instead");
  SetSkipped(std::vector<int32_t>(skipped.begin(), skipped.end()), &gaps_);
  if (gaps_.skipped_size() > kMaxFrameRanges) {
    return absl::InvalidArgumentError(absl::StrCat("skip: the frames are ", gaps_.skipped_size(),
                                                   " ranges; the limit is ", kMaxFrameRanges));
  }
  changes_gaps_ = !std::equal(skipped.begin(), skipped.end(), before.begin(), before.end()) ||
                  gaps_.skip_failed() != job.gaps.skip_failed();
  return absl::OkStatus();
}

void ReopenPlan::PlanFrames(const ReopenedJob& job, const ReopenRequest& request,
                            const std::set<int32_t>& named) {
  const bool needs_film = request.filter_only || request.region.has_value();
  for (const int32_t frame : job.frames) {
    const bool is_finished = std::binary_search(job.finished.begin(), job.finished.end(), frame);
    const bool is_skipped = IsSkipped(gaps_, frame);
    if (is_skipped && !IsSkipped(job.gaps, frame)) forgotten_.push_back(frame);
    if (is_skipped || (is_finished && !named.contains(frame))) continue;
    frames_.push_back(frame);
    forgotten_.push_back(frame);
    if (is_finished && !request.samples_per_pixel.has_value() && needs_film) need_film_.push_back(frame);
  }
}

bool ReopenPlan::Keeps(const UnitKey& key) const {
  if (!std::binary_search(frames_.begin(), frames_.end(), key.frame)) return false;
  if (!before_.NumberOf(key).has_value() || !after_.NumberOf(key).has_value()) return false;
  if (before_.SamplesOf(key) != after_.SamplesOf(key)) return false;
  const bool is_again =
      again_frames_.contains(key.frame) && (!again_tiles_.has_value() || again_tiles_->contains(key.tile));
  return !is_again;
}

ReopenPlan::Kept ReopenPlan::KeptOf(int32_t frame) const {
  if (again_frames_.contains(frame)) return again_tiles_.has_value() ? Kept::kSome : Kept::kNone;
  const UnitKey last = {frame, 0, before_.pass_count() - 1, v1::UNIT_KIND_PASS};
  return Keeps(last) ? Kept::kAll : Kept::kSome;  // only the last pass can have changed
}

}  // namespace lumifold::job
