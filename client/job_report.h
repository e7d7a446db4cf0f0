#pragma once

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "client/exit_code.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// "queued", "rendering", "filtering", "done", "failed", "cancelled"; "unknown" for a state of a later
/// version.
absl::string_view StateName(v1::JobState state);

/// True when the job will not change any more.
bool HasEnded(const v1::JobStatus& status);

/// The job's fate as an exit code: kOk for done and for one that has not ended.
ExitCode ExitCodeForFate(const v1::JobStatus& status);

/// One JSON object on one line, without the line's end; its fields are described in docs/cli.md and never
/// change their meaning. `more` is appended as fields of text. Bytes that are no UTF-8 are replaced.
std::string JobJson(const v1::JobStatus& status,
                    const std::vector<std::pair<std::string, std::string>>& more = {});

/// "render 3.21 s, assemble 0.02 s, filter 0.50 s, write 0.11 s".
std::string StageTimesText(const v1::StageTimes& times);

/// The job in lines of "name: value".
std::string JobText(const v1::JobStatus& status);

/// A line of `lumifold list`, and the head above them.
std::string JobTableHead();
std::string JobTableLine(const v1::JobStatus& status);

}  // namespace lumifold::client
