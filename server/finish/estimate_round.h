#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/rounds.pb.h"
#include "server/job/frame_rounds.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// The record of the rounds of a frame, at DataFolder::RoundsPath; empty before the first estimate.
/// Errors: kDataLoss where it is damaged; kUnavailable. Both name the file.
absl::StatusOr<v1::RoundEstimates> ReadEstimates(const std::string& path);

/// The rounds of a frame of a job with adaptive sampling, as its record has them; those before the first
/// estimate if there is no record. `spec` is normalised.
/// Errors: kDataLoss where the record is damaged; kUnavailable. Both name the file.
absl::StatusOr<job::FrameRounds> ReadRounds(const DataFolder& folder, const job::JobId& job,
                                            const v1::JobSpec& spec, int32_t frame);

/// Errors of a round that a worker has estimated, until the estimate is recorded; the next start removes
/// them.
std::string ErrorsPath(const DataFolder& folder, const job::JobId& job, int32_t frame, int round);

struct RoundToEstimate {
  job::JobId job;
  /// In which the caller owns the job.
  ledger::Epoch epoch;
  int32_t frame = 0;
  int round = 0;
  /// Render time of the job when the round was committed.
  absl::Duration rendered = {};
  /// Camera samples of the job that were committed then, of all its frames.
  int64_t samples = 0;
  /// A worker has filtered the round in this time, and its errors are at ErrorsPath.
  std::optional<absl::Duration> filtered = std::nullopt;
};

/// Estimates the error of a frame's filtered picture once a round is committed, from the units of this round
/// and those before it alone, and adds the estimate to the frame's record; for a job with a time also the
/// budget that follows from `rendered`, `samples` and the time of filtering. A repeated call writes the same
/// estimate, and nothing where the record has it. Errors of a worker that cannot be read are estimated here.
/// Durable once it returns OK. Returns the time of each stage,
/// measured with `now`.
/// Memory: two films and pictures.
/// Errors: as FinishFrame; then nothing has been written; kFailedPrecondition for a round whose turn it is
/// not.
/// Threads: safe for different frames; the estimate does not depend on `pool`, which may be null.
absl::StatusOr<v1::FrameReport> EstimateRound(const DataFolder& folder, ledger::JobStore& store,
                                              const RoundToEstimate& what, TaskPool* pool,
                                              const std::function<absl::Time()>& now);

}  // namespace lumifold::server
