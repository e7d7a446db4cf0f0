#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/file_system.h"
#include "server/job/ids.h"
#include "server/job/reopen_plan.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// Makes the unit logs of the plan's frames hold only units that the plan keeps, and returns the frames that
/// have no log. The job must not be active: nobody else uses its logs. Reads the logs of frames of which some
/// units are kept. It can be repeated; after a crash in the middle the logs hold some units more than the
/// plan keeps, and never fewer.
/// Errors: kFailedPrecondition naming a frame that has no log but needs one
/// (ReopenPlan::frames_that_need_film); then nothing is changed. kUnavailable with the system's message.
absl::StatusOr<std::vector<int32_t>> ReviseFilm(const DataFolder& folder, const job::JobId& job,
                                                const job::ReopenPlan& plan,
                                                FileSystem* files = PrivateFileSystem());

}  // namespace lumifold::server
