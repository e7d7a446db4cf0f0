#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/backoff.h"
#include "client/farm_client.h"
#include "client/progress.h"

namespace lumifold::client {

/// Where a frame of a job is kept while it is on its way to `output`: beside it, and named after the job, so
/// that what is left of one job is never taken for the beginning of another. Errors: kNotFound for a text
/// that cannot be a job's id.
absl::StatusOr<std::string> PartPath(const std::string& output, const std::string& job_id, int frame);

/// Brings a frame's file to `part_path`, all of it and on the disk. What an earlier call left there is not
/// sent again; a connection that breaks is opened anew as long as `backoff` allows, each time going on where
/// it stopped. Errors: as FarmClient's; what has arrived stays for the next call, but nothing is left where
/// nothing arrived.
absl::Status DownloadFrame(FarmClient& farm, const std::string& job_id, int frame,
                           const std::string& part_path, Progress& progress, Backoff backoff);

}  // namespace lumifold::client
