#include "server/coordinator/explain.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace lumifold::server {
namespace {

using job::JobId;

/// Jobs that a reason names.
constexpr size_t kMaxNamedJobs = 4;

std::string TextOf(const std::vector<JobId>& waits_for) {
  const size_t named = std::min(waits_for.size(), kMaxNamedJobs);
  std::string text = absl::StrCat(
      "the job waits until these are done: ",
      absl::StrJoin(waits_for.begin(), waits_for.begin() + static_cast<std::ptrdiff_t>(named), ", ",
                    [](std::string* out, const JobId& job) { absl::StrAppend(out, job.value()); }));
  if (named < waits_for.size()) absl::StrAppend(&text, " and ", waits_for.size() - named, " more");
  return text;
}

/// What a worker has of a frame, before the frame's name.
std::string PartNameOf(const RunningFrame& frame) {
  if (frame.part().IsBlock())
    return absl::StrCat("block ", frame.block, " of ", frame.due.block_count, " of ");
  return frame.part().IsEstimate() ? absl::StrCat("round ", frame.due.round, " of ") : "";
}

/// Adds which frames of the job are being filtered.
void ExplainRunning(const Farm& farm, const JobId& job, absl::Time now, v1::ExplainJobResponse* response) {
  for (const RunningFrame& frame : farm.frames.running()) {
    if (frame.due.job != job) continue;
    if (frame.worker.has_value()) {
      AddReason("filter_worker",
                absl::StrCat(PartNameOf(frame), "frame ", frame.due.number, " has been with worker ",
                             farm.workers.NameOf(*frame.worker), " for ",
                             absl::ToInt64Seconds(now - frame.since), " s, which filters it"),
                response);
      continue;
    }
    AddReason("filter_running",
              absl::StrCat("frame ", frame.due.number, " has been in the filter for ",
                           absl::ToInt64Seconds(now - frame.since), " s, on ", frame.threads,
                           frame.threads == 1 ? " thread" : " threads"),
              response);
  }
}

/// Adds why frames of the job that are rendered have no result yet.
void ExplainFinishing(const FrameQueue& frames, const JobId& job, absl::Time now,
                      v1::ExplainJobResponse* response) {
  const auto due = std::count_if(frames.waiting().begin(), frames.waiting().end(),
                                 [now](const DueFrame& frame) { return frame.not_before <= now; });
  bool is_first = true;
  for (const DueFrame& frame : frames.waiting()) {
    if (frame.job != job) continue;
    if (frame.not_before > now && frame.failures > 0) {
      AddReason(
          "filter_retry",
          absl::StrCat("the filter of frame ", frame.number, " failed ", frame.failures,
                       " times and is tried again in ",
                       absl::ToInt64Seconds(absl::Ceil(frame.not_before - now, absl::Seconds(1))), " s"),
          response);
    } else if (is_first && !frame.keeper.has_value()) {
      AddReason("filter_queue",
                absl::StrCat("frame ", frame.number, " waits for the filter, which has ", frames.CountHere(),
                             " frames of this and other jobs; ", due, " wait"),
                response);
      is_first = false;
    }
  }
}

}  // namespace

void AddReason(const std::string& code, const std::string& text, v1::ExplainJobResponse* response) {
  v1::Reason* const reason = response->add_reasons();
  reason->set_code(code);
  reason->set_text(text);
}

std::string NameOfAsset(const v1::AssetRef& asset) {
  return asset.uri().empty() ? "the scene file" : absl::StrCat("'", asset.uri(), "'");
}

void ExplainWaiting(const Farm& farm, const JobId& job, absl::Time now, v1::ExplainJobResponse* response) {
  if (const std::vector<JobId> waits_for = farm.dependencies.WaitsFor(job); !waits_for.empty())
    AddReason("after", TextOf(waits_for), response);
  const ActiveJob* const active = farm.jobs.FindActive(job);
  if (active != nullptr && active->wanted_asset.has_value()) {
    AddReason("asset",
              absl::StrCat(NameOfAsset(*active->wanted_asset), " (", active->wanted_asset->sha256(),
                           ") is missing or damaged; submit the scene again to upload it"),
              response);
  }
  // The scheduler knows one kind of pause: those of other jobs and of files have been told.
  const bool is_paused = active != nullptr && active->record.scheduling.paused();
  for (const scheduler::Reason& reason : farm.scheduler.Explain(job, now)) {
    if (reason.code != "paused" || is_paused) AddReason(reason.code, reason.text, response);
  }
  ExplainRunning(farm, job, now, response);
  ExplainFinishing(farm.frames, job, now, response);
}

}  // namespace lumifold::server
