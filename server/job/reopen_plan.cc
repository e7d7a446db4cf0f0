#include "server/job/reopen_plan.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "server/job/job_spec.h"

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
  if (request.region.has_value()) {
    absl::StatusOr<std::set<int32_t>> tiles = TilesNamed(job.spec, *request.region);
    if (!tiles.ok()) return tiles.status();
    plan.again_tiles_ = *std::move(tiles);
  }
  const bool names_parts = !request.frames.empty() || request.region.has_value() || request.filter_only;
  const bool has_failed = job.state == v1::JOB_STATE_FAILED || job.state == v1::JOB_STATE_CANCELLED;
  const bool is_done = job.state == v1::JOB_STATE_DONE;
  const bool adds_samples = request.samples_per_pixel.has_value();
  if (adds_samples && *request.samples_per_pixel == job.spec.samples_per_pixel()) return plan;
  if (!adds_samples && !names_parts && !has_failed && !is_done) return plan;
  const bool goes_on = !adds_samples && !names_parts && has_failed;
  if (goes_on) named->clear();
  if (!adds_samples && !request.filter_only) plan.again_frames_ = *named;
  for (const int32_t frame : job.frames) {
    const bool is_finished = std::binary_search(job.finished.begin(), job.finished.end(), frame);
    const bool is_named = named->contains(frame);
    if (is_finished && !is_named) continue;
    plan.frames_.push_back(frame);
    if (is_finished && !adds_samples && (request.filter_only || request.region.has_value()))
      plan.need_film_.push_back(frame);
  }
  return plan;
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
