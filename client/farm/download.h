#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/progress.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"

namespace lumifold::client {

/// Path of a partial download of a frame: in the folder of `output`, with the job id in its name, so that the
/// download of another job never resumes from it.
/// Errors: kNotFound for a text that is not a valid job id.
absl::StatusOr<std::string> PartPath(const std::string& output, const std::string& job_id, int frame);

/// Downloads a frame's file to `part_path`, syncs it and compares it with the SHA-256 that the coordinator
/// states. Resumes a partial download of an earlier call, and reconnects and resumes after a broken
/// connection as long as `backoff` allows. A resumed download that does not match starts over, once.
/// Errors: those of FarmClient; the bytes received stay for the next call. kDataLoss where the file does not
/// match or the coordinator states no SHA-256; the file is then removed. No file is created if no byte
/// arrived.
absl::Status DownloadFrame(FarmClient& farm, const std::string& job_id, int frame,
                           const std::string& part_path, Progress& progress, Backoff backoff);

}  // namespace lumifold::client
