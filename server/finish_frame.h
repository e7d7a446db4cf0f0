#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/data_folder.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// Turns a merged frame into its result file: reads the units the ledger names, assembles the film, filters
/// it and writes the OpenEXR file whole. Doing it again gives the same bytes. Gives the seconds each stage
/// took by `now`.
/// Errors: kNotFound without such a job; kDataLoss naming the record that is damaged or missing; those of the
/// filter; kUnavailable when the disk refuses.
/// Threads: safe for different frames; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::StageTimes> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                           const scheduler::JobId& job, int32_t frame, TaskPool* pool,
                                           const std::function<absl::Time()>& now);

}  // namespace lumifold::server
