#pragma once

#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/cli/exit_code.h"
#include "client/cli/frame_range.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// "submitted", "planned", "running", "paused", "filtering", "done", "done-with-gaps", "failed" or
/// "cancelled"; "unknown" for a state of a later version.
absl::string_view StateName(v1::JobState state);

/// The inverse.
/// Errors: kInvalidArgument naming the states.
absl::StatusOr<v1::JobState> ParseStateName(absl::string_view name);

/// True if the job is done, with gaps or without.
bool IsDone(const v1::JobStatus& status);

/// Frames that the job is done without. Of a status of GetJob or WatchJob.
std::vector<FrameRange> SkippedFrames(const v1::JobStatus& status);

/// True if the job is done, failed or cancelled.
bool HasEnded(const v1::JobStatus& status);

/// Exit code for the state of a job: kOk if it is done without gaps, or has not ended.
ExitCode ExitCodeForOutcome(const v1::JobStatus& status);

/// Which of its frames are being finished: "2 in the filter, 4 waiting"; empty if there are none.
std::string FilteringText(const v1::JobStatus& status);

/// One JSON object in one line, without the newline. docs/cli.md documents its fields; their meaning never
/// changes. `more` is appended as text fields. Bytes that are not UTF-8 are replaced.
std::string JobJson(const v1::JobStatus& status,
                    const std::vector<std::pair<std::string, std::string>>& more = {});

/// "render 3.21 s, assemble 0.02 s, filter 0.50 s, write 0.11 s".
std::string StageTimesText(const v1::StageTimes& times);

/// The job as lines of "name: value".
std::string JobText(const v1::JobStatus& status);

/// A line of `lumifold list`, and its header line.
std::string JobTableHead();
std::string JobTableLine(const v1::JobStatus& status);

}  // namespace lumifold::client
