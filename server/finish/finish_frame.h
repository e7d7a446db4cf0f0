#pragma once

#include <cstdint>
#include <functional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/blocks.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// Makes the result file of a committed frame: assembles the film from the committed units, filters it and
/// writes the OpenEXR file. A frame of more than one of `blocks` is assembled and filtered block by block and
/// written in bands of rows, so that memory holds one block, not the film. A repeated call writes the same
/// bytes. Returns the time of each stage, measured with `now`.
/// Errors: kNotFound for an unknown job; kDataLoss naming the damaged or missing record; those of the filter;
/// kUnavailable for a disk error; kAborted where the job has another owner by the end: then the result is not
/// replaced.
/// Threads: safe for different frames; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::FrameReport> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                            const ledger::OwnedJob& job, int32_t frame, TaskPool* pool,
                                            const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks = {});

/// Memory that finishing a frame of the job takes, at most: with all layers and levels.
uint64_t FinishMemoryOf(const v1::JobSpec& spec);

}  // namespace lumifold::server
