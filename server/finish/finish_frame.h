#pragma once

#include <functional>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/blocks.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// Makes the result file of a committed frame by MakePicture, and its digest. A repeated call writes the same
/// bytes. Of the blocks named in `ready` the picture is at DataFolder::BlockPath; one that cannot be read is
/// made here. `progress` is told how far the filter is. Returns the time of each stage, measured with `now`.
/// Errors: kNotFound for an unknown job; those of MakePicture; kAborted where the job has another owner by
/// the end: then the result is not replaced.
/// Threads: safe for different frames; the file does not depend on `pool`, which may be null.
absl::StatusOr<v1::FrameReport> FinishFrame(const DataFolder& folder, ledger::JobStore& store,
                                            const ledger::OwnedJob& job, int32_t frame, TaskPool* pool,
                                            const std::function<absl::Time()>& now,
                                            const filter::BlockParams& blocks = {},
                                            const std::vector<int>& ready = {},
                                            const FilterProgress& progress = nullptr);

/// Writes the picture of one block of a committed frame to DataFolder::BlockPath, by MakeBlock: the bytes
/// that a worker would deliver. Returns its time, measured with `now`.
/// Errors: as FinishFrame. Threads: as FinishFrame, for different blocks.
absl::StatusOr<v1::FrameReport> FilterBlock(const DataFolder& folder, ledger::JobStore& store,
                                            const ledger::OwnedJob& job, int32_t frame, int block,
                                            TaskPool* pool, const std::function<absl::Time()>& now);

}  // namespace lumifold::server
