#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "lumifold/v1/job.pb.h"
#include "server/job/unit.h"

namespace lumifold::ledger {

/// A job when it is first recorded.
struct NewJob {
  job::JobId id;
  /// Chosen by the client; unique.
  std::string request_id;
  /// Normalised.
  v1::JobSpec spec;
  absl::Time submitted;
};

/// A job as recorded in the ledger.
struct JobRecord {
  job::JobId id;
  v1::JobSpec spec;
  /// JOB_STATE_QUEUED for every job that has not ended; otherwise DONE, FAILED or CANCELLED.
  v1::JobState state = v1::JOB_STATE_QUEUED;
  std::string error;
  /// Empty until a unit of the job is committed.
  std::string numeric_class;
  absl::Time submitted;
  /// Time of the first lease; InfinitePast until a unit of the job is committed.
  absl::Time started = absl::InfinitePast();
  int64_t units_done = 0;
  int64_t samples_done = 0;
  int64_t bad_samples = 0;
  int32_t frames_done = 0;
  v1::StageTimes times;
  /// Each line once, in the order of first occurrence, at most job::kMaxJobWarnings.
  std::vector<std::string> warnings;
  /// Further warnings of units that are not among `warnings`; a line of several units counts once for each.
  int64_t warnings_left_out = 0;
};

/// A committed unit: the position of its record and its statistics.
struct UnitRecord {
  job::UnitRef unit;
  /// Path of the unit log relative to the data folder, and position of the record in it.
  std::string file;
  uint64_t offset = 0;
  uint64_t length = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;
};

/// Changes of a job's row that are recorded together with its units.
struct JobUpdate {
  job::JobId job;
  std::string numeric_class;
  absl::Time started;
  /// Warnings of all the units, one after the other; lines may repeat.
  std::vector<std::string> warnings;
};

/// The durable record of jobs and of committed units. The effect of a call survives any crash once the call
/// has returned OK.
/// Errors, unless stated otherwise: kUnavailable with the message of the storage; kNotFound for an unknown
/// job.
/// Threads: safe.
class JobStore {
 public:
  virtual ~JobStore() = default;

  /// Records a job and returns its id, or the id of the job that is already recorded with the same request
  /// id.
  virtual absl::StatusOr<job::JobId> CreateJob(const NewJob& job) = 0;
  virtual absl::StatusOr<JobRecord> GetJob(const job::JobId& job) = 0;
  /// Newest first, at most `limit`.
  virtual absl::StatusOr<std::vector<JobRecord>> ListJobs(int limit) = 0;
  /// Jobs that have not ended, oldest first.
  virtual absl::StatusOr<std::vector<JobRecord>> UnfinishedJobs() = 0;

  /// Commits units and the updates of their jobs in one transaction. A unit is committed once: if one of the
  /// units already is, nothing is recorded and the error is kAlreadyExists naming that unit.
  virtual absl::Status CommitUnits(absl::Span<const UnitRecord> units,
                                   absl::Span<const JobUpdate> updates) = 0;
  /// Takes back units of a job whose records cannot be read, in one transaction: their rows go, and the job's
  /// counts are reduced by them. No effect for a unit that is not committed.
  virtual absl::Status RevokeUnits(const job::JobId& job, absl::Span<const UnitRecord> units) = 0;
  /// Visits the committed units of a frame, or of all frames in order. Within a frame they are ordered by
  /// tile, then kind (passes before geometry), then pass. `visit` must not call the store.
  virtual absl::Status ForEachUnit(const job::JobId& job, std::optional<int32_t> frame,
                                   absl::FunctionRef<void(const UnitRecord&)> visit) = 0;

  /// Records that a frame's result is written, and adds `times` to those of the job. No effect for a frame
  /// that is already recorded.
  virtual absl::Status RecordFrame(const job::JobId& job, int32_t frame, const v1::StageTimes& times) = 0;
  /// Frames of a job whose result is written, in ascending order.
  virtual absl::StatusOr<std::vector<int32_t>> FinishedFrames(const job::JobId& job) = 0;
  /// Ends a job. No effect on a job that has ended.
  virtual absl::Status EndJob(const job::JobId& job, v1::JobState state, const std::string& error) = 0;
};

}  // namespace lumifold::ledger
