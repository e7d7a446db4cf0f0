#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/blocks.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/data_folder.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// Turns a merged frame into its result file: assembles the film from the units the ledger names, filters it
/// and writes the OpenEXR file whole. A frame of more than one of `blocks` is assembled and filtered block by
/// block and written in rows: in memory is a block, not the film. Doing it again gives the same bytes. Gives
/// the seconds each stage took by `now`.
/// Errors: kNotFound without such a job; kDataLoss naming the record that is damaged or missing; those of the
/// filter; kUnavailable when the disk refuses.
/// Threads: safe for different frames; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::StageTimes> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                           const scheduler::JobId& job, int32_t frame, TaskPool* pool,
                                           const std::function<absl::Time()>& now,
                                           const filter::BlockParams& blocks = {});

}  // namespace lumifold::server
