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

/// A job as it is first recorded.
struct NewJob {
  scheduler::JobId id;
  /// The client's; unique.
  std::string request_id;
  /// Normalised.
  v1::JobSpec spec;
  absl::Time submitted;
};

/// A job as the ledger knows it.
struct JobRecord {
  scheduler::JobId id;
  v1::JobSpec spec;
  /// JOB_STATE_QUEUED for every job that has not ended; else DONE, FAILED or CANCELLED.
  v1::JobState state = v1::JOB_STATE_QUEUED;
  std::string error;
  /// Empty until a unit of it was merged.
  std::string numeric_class;
  absl::Time submitted;
  /// When its first lease was given; InfinitePast before a unit of it was merged.
  absl::Time started = absl::InfinitePast();
  int64_t units_done = 0;
  int64_t samples_done = 0;
  int64_t bad_samples = 0;
  int32_t frames_done = 0;
  v1::StageTimes times;
  /// Each line once, in the order they were first heard.
  std::vector<std::string> warnings;
};

/// A merged unit: where its record lies and what it says of itself.
struct UnitRecord {
  scheduler::UnitRef unit;
  /// The unit log's name within the data folder, and the record in it.
  std::string file;
  uint64_t offset = 0;
  uint64_t length = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;
};

/// What one transaction adds about a job, beside its units.
struct JobNews {
  scheduler::JobId job;
  std::string numeric_class;
  absl::Time started;
  std::vector<std::string> warnings;
};

/// The durable record of jobs and of which units are merged. What a call has recorded survives any crash once
/// it has returned OK.
/// Errors, where nothing else is said: kUnavailable with the storage's words; kNotFound for a job that is not
/// there.
/// Threads: safe.
class JobStore {
 public:
  virtual ~JobStore() = default;

  /// Records a job; gives its id, or that of the job already recorded under the same request id.
  virtual absl::StatusOr<scheduler::JobId> CreateJob(const NewJob& job) = 0;
  virtual absl::StatusOr<JobRecord> GetJob(const scheduler::JobId& job) = 0;
  /// Newest first, at most `limit`.
  virtual absl::StatusOr<std::vector<JobRecord>> ListJobs(int limit) = 0;
  /// Jobs that have not ended, oldest first.
  virtual absl::StatusOr<std::vector<JobRecord>> UnfinishedJobs() = 0;

  /// Records merged units and news of their jobs, all in one transaction. A unit enters once: where one of
  /// them is recorded already nothing is, and the error is kAlreadyExists naming it.
  virtual absl::Status CommitUnits(absl::Span<const UnitRecord> units, absl::Span<const JobNews> news) = 0;
  /// The units of a frame, or of all frames one after another, ordered by tile, then kind (passes before
  /// geometry), then pass. `visit` must not call the store.
  virtual absl::Status ForEachUnit(const scheduler::JobId& job, std::optional<int32_t> frame,
                                   absl::FunctionRef<void(const UnitRecord&)> visit) = 0;

  /// Records that a frame's result is written, and adds `times` to the job's. A frame already recorded stays
  /// as it is.
  virtual absl::Status RecordFrame(const scheduler::JobId& job, int32_t frame,
                                   const v1::StageTimes& times) = 0;
  /// Frames of a job whose result is written, in order.
  virtual absl::StatusOr<std::vector<int32_t>> FinishedFrames(const scheduler::JobId& job) = 0;
  /// Ends a job; one that has ended stays as it is.
  virtual absl::Status EndJob(const scheduler::JobId& job, v1::JobState state, const std::string& error) = 0;
};

}  // namespace lumifold::ledger
