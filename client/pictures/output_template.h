#pragma once

#include <string>

#include "absl/status/status.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Names of outputs have placeholders: {job} (id), {name}, {user}, and # for the number of the frame, see
/// PathOfFrame. What they stand for has no "/" and does not begin with ".": such characters become "_".

/// Errors: kInvalidArgument for a placeholder that there is not.
absl::Status CheckTemplate(const std::string& path);

/// Whether a job must be known to say what the path is.
bool NeedsJob(const std::string& path);

/// The path of a frame's file. `path` is one that CheckTemplate accepts.
std::string PathOfOutput(const std::string& path, const v1::JobStatus& job, int frame);

/// The longest folder of `path` that has no placeholders and is known before the job is.
std::string KnownFolderOf(const std::string& path);

}  // namespace lumifold::client
