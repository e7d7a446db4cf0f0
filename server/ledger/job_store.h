#pragma once

#include <algorithm>
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
#include "server/ledger/delivery_queue.h"
#include "server/ledger/owner.h"

namespace lumifold::ledger {

/// A job when it is first recorded.
struct NewJob {
  job::JobId id;
  /// Chosen by the client; unique.
  std::string request_id;
  /// Normalised.
  v1::JobSpec spec;
  v1::Scheduling scheduling = {};
  absl::Time submitted;
  Owner owner = {};
};

/// What of a job is rendered.
struct WorkDone {
  int64_t units = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;
  int32_t frames = 0;
};

/// A job as recorded in the ledger.
struct JobRecord {
  job::JobId id;
  /// In a JobPage without the dependencies of its scene: they may have megabytes.
  v1::JobSpec spec;
  v1::Scheduling scheduling;
  Owner owner;
  /// JOB_STATE_SUBMITTED for every job that has not ended; otherwise DONE, DONE_WITH_GAPS, FAILED or
  /// CANCELLED.
  v1::JobState state = v1::JOB_STATE_SUBMITTED;
  std::string error;
  /// Empty until a unit of the job is committed.
  std::string numeric_class;
  absl::Time submitted;
  /// Time of the first lease; InfinitePast until a unit of the job is committed.
  absl::Time started = absl::InfinitePast();
  WorkDone done;
  /// Of a job that was reopened: what earlier attempts have cost is counted.
  job::Attempt counted = {};
  v1::StageTimes times;
  /// The largest of those frames that were estimated.
  std::optional<double> estimated_error = {};
  void NoteError(double of_frame) {
    estimated_error = std::max(estimated_error.value_or(of_frame), of_frame);
  }
  /// Each line once, in the order of first occurrence, at most job::kMaxJobWarnings. Empty in a JobPage.
  std::vector<std::string> warnings;
  /// Further warnings of units that are not among `warnings`; a line of several units counts once for each.
  int64_t warnings_left_out = 0;
};

/// A job whose row is damaged.
struct DamagedJob {
  job::JobId id;
  /// kInternal naming the job and what cannot be read.
  absl::Status error;
};

struct ClaimedJobs {
  /// Oldest first.
  std::vector<JobRecord> jobs;
  /// They are claimed as well: EndJob can end them.
  std::vector<DamagedJob> damaged;
};

struct JobFilter {
  /// Maximum number of jobs on the page, at least 1.
  int limit = 100;
  /// JobPage::next of the page before; nullopt for the first page.
  std::optional<int64_t> before = std::nullopt;
  /// Recorded states, so JOB_STATE_SUBMITTED stands for every job that has not ended. Empty: all.
  std::vector<v1::JobState> states = {};
  /// Scheduling.user. Empty: all.
  std::string user = {};
};

struct JobPage {
  /// Newest first.
  std::vector<JobRecord> jobs;
  /// Jobs of this page whose rows are damaged; they count for the limit.
  std::vector<DamagedJob> damaged;
  /// nullopt on the last page.
  std::optional<int64_t> next;
};

/// What a job that runs again is from now on.
struct Reopening {
  v1::JobSpec spec;
  v1::Scheduling scheduling;
  /// Frames that are not recorded and have no units.
  std::vector<int32_t> frames;
  /// What earlier attempts have cost is counted.
  job::Attempt counted = {};
};

/// How a job ends.
struct JobEnd {
  v1::JobState state;
  std::string error;
  /// Is waiting once the end is recorded.
  std::optional<NewDelivery> delivery = {};
};

/// Work that was committed: units rendered, and frames finished.
struct Work {
  int64_t units = 0;
  /// Seconds of one core.
  double render_seconds = 0;
  int64_t frames = 0;
  double finish_seconds = 0;
};

/// What was spent on a job, which may be deleted.
struct JobUsage {
  job::JobId job;
  std::string user;
  Work work;
};

/// Days for which usage is kept after its day.
inline constexpr int64_t kUsageDays = 400;

/// Work of whole days, UTC: from that of `since` to before that of `until`.
struct UsageFilter {
  absl::Time since;
  absl::Time until;
  /// Empty: all.
  std::string user = {};
  int limit = 10'000;
};

/// When a unit was rendered, and the seconds of one core.
struct UnitCost {
  absl::Time at;
  double seconds = 0;
};

/// A committed unit: who rendered it, the position of its record and its statistics.
struct UnitRecord {
  job::UnitRef unit;
  job::Attempt attempt = {};
  /// Name of the worker; empty where it is not known.
  std::string worker = {};
  /// Path of the unit log relative to the data folder, and position of the record in it.
  std::string file;
  uint64_t offset = 0;
  uint64_t length = 0;
  int64_t samples = 0;
  int64_t bad_samples = 0;
  /// nullopt where it is counted already, as of units that a reopened job has kept. It is not read back.
  std::optional<UnitCost> cost = {};
};

/// Units of one job that are committed together, and changes of the job's row.
struct JobCommit {
  OwnedJob job;
  /// Recorded with the first unit of the job.
  std::string numeric_class;
  absl::Time started = absl::InfinitePast();
  /// Warnings of all the units, one after the other; lines may repeat.
  std::vector<std::string> warnings;
  std::vector<UnitRecord> units;
  /// The units were read back from unit logs: their attempts may be of other epochs as well.
  bool recovered = false;
};

struct BlockedWorker {
  std::string name;
  std::string reason;

  friend bool operator==(const BlockedWorker&, const BlockedWorker&) = default;
};

/// The durable record of jobs and of committed units. The effect of a call survives any crash once the call
/// has returned OK; a call that returns an error has no effect, except that after kUnavailable it may have
/// one. Every call can be repeated with the same arguments.
///
/// Owners. Several coordinators may use one store. A job belongs to one of them at a time: the epoch of its
/// owner is in its row, and a call that writes to the job names the epoch. If it is not that of the row, the
/// caller has lost the job.
///
/// Errors, unless stated otherwise:
///   kUnavailable        with its cause: the storage is full, busy, out of memory or not connected, or it
///                       failed to read or write. It may work again later.
///   kDataLoss           the database is malformed.
///   kInternal           naming a job whose row is damaged. Other jobs are not affected.
///   kNotFound           there is no such job.
///   kAborted            naming both epochs: the job belongs to another epoch than the caller's.
///   kFailedPrecondition the job has ended (a call that needs an active one), or has not (DeleteJob).
///   kInvalidArgument    a text has a NUL character.
/// Threads: safe. Reads do not wait for writes.
class JobStore {
 public:
  virtual ~JobStore() = default;

  /// Draws the next epoch, which is above all epochs that were drawn before, and above `floor`.
  virtual absl::StatusOr<Epoch> NewEpoch(Epoch floor = {}) = 0;

  /// Records a job and returns its id, or the id of the job that is already recorded with the same request
  /// id.
  /// Errors: kAlreadyExists where the recorded request has another spec or scheduling, or the id is taken.
  virtual absl::StatusOr<job::JobId> CreateJob(const NewJob& job) = 0;
  /// The id that CreateJob would return because the request is recorded; nullopt where it is not. The id of
  /// `job` does not count.
  /// Errors: as CreateJob for a request id of another spec or scheduling.
  virtual absl::StatusOr<std::optional<job::JobId>> FindRequest(const NewJob& job) = 0;
  /// Makes `owner` the owner of all jobs that have not ended, and returns them.
  /// Errors: kAborted where a later epoch owns one of them; then none is claimed.
  virtual absl::StatusOr<ClaimedJobs> ClaimUnfinishedJobs(const Owner& owner) = 0;
  virtual absl::StatusOr<JobRecord> GetJob(const job::JobId& job) = 0;
  /// Jobs by the time of their submission. Time: independent of the number of jobs.
  virtual absl::StatusOr<JobPage> ListJobs(const JobFilter& filter) = 0;

  /// Commits units of several jobs in one transaction. Each job's part is recorded wholly or not at all; the
  /// outcomes are in the order of `commits`: OK; kAlreadyExists naming a unit that is committed with another
  /// attempt or place, or whose frame is recorded; kAborted for another epoch than the job's, or for an
  /// attempt of another epoch; kNotFound; kFailedPrecondition. A unit that is already committed with the same
  /// attempt and place is not recorded again, so that a commit whose outcome is not known can be repeated. An
  /// error of the call itself: nothing is recorded.
  virtual absl::StatusOr<std::vector<absl::Status>> CommitUnits(absl::Span<const JobCommit> commits) = 0;
  /// Takes back units of a job whose records cannot be read, in one transaction: their rows go, and the job's
  /// counts are reduced by what the rows state. No effect for a unit that is not committed.
  virtual absl::Status RevokeUnits(const OwnedJob& job, absl::Span<const job::UnitKey> units) = 0;
  /// Visits the committed units of an unrecorded frame, or of all of them in order. Within a frame units are
  /// ordered by tile, then kind (passes before geometry), then pass. `visit` must not call the store.
  virtual absl::Status ForEachUnit(const job::JobId& job, std::optional<int32_t> frame,
                                   absl::FunctionRef<void(const UnitRecord&)> visit) = 0;

  /// Records that a frame's result is written, and adds `times` to those of the job. The frame's units are no
  /// longer visited; PurgeUnits deletes their rows. No effect for a frame that is already recorded.
  virtual absl::Status RecordFrame(const OwnedJob& job, int32_t frame, const v1::FrameReport& report) = 0;
  /// The same where a worker has kept the frame's units: in one transaction they are counted as CommitUnits
  /// counts, each once, without rows. Errors: also kAlreadyExists where units of the frame are committed.
  virtual absl::Status RecordKeptFrame(const JobCommit& units, int32_t frame,
                                       const v1::FrameReport& report) = 0;
  /// Recorded frames of a job, in ascending order.
  virtual absl::StatusOr<std::vector<int32_t>> FinishedFrames(const job::JobId& job) = 0;
  /// Names of the workers that delivered committed units of a job, of recorded frames, too.
  virtual absl::StatusOr<std::vector<std::string>> DeliverersOf(const job::JobId& job) = 0;
  /// Ends a job. Its units are no longer visited, and PurgeUnits deletes their rows; its counts stay. No
  /// effect on a job that has ended.
  virtual absl::Status EndJob(const OwnedJob& job, const JobEnd& end) = 0;
  /// Calls of webhooks; those of a job go with it.
  virtual DeliveryQueue& deliveries() = 0;
  /// Makes a job active; its counts are those of the other frames. If nothing of the job is left, it has no
  /// numeric class. A job that has ended becomes that of `owner`; one that has not must already be.
  /// Errors: kAborted also where the job that has ended belonged to a later epoch.
  virtual absl::Status ReopenFrames(const job::JobId& job, const Owner& owner,
                                    const Reopening& reopening) = 0;
  virtual absl::Status SetScheduling(const OwnedJob& job, const v1::Scheduling& scheduling) = 0;
  /// Gives a job its plan: `planned` replaces its spec. A request with the spec that was submitted still
  /// finds the job.
  virtual absl::Status SetPlan(const OwnedJob& job, const v1::JobSpec& planned) = 0;
  /// Deletes a job that has ended. Its id and its request id are free again.
  virtual absl::Status DeleteJob(const job::JobId& job) = 0;
  /// Deletes at most `max_rows` rows of units that are no longer visited, and returns how many are left.
  virtual absl::StatusOr<int64_t> PurgeUnits(int64_t max_rows) = 0;

  /// What was spent on jobs, the most first. Each committed unit and each recorded frame counts once, on the
  /// day that it states, and stays when its job is deleted. Days older than kUsageDays are dropped.
  virtual absl::StatusOr<std::vector<JobUsage>> Usage(const UsageFilter& filter) = 0;

  /// Records that a worker is blocked; a later reason replaces an earlier one.
  virtual absl::Status BlockWorker(const std::string& name, const std::string& reason) = 0;
  /// Errors: kNotFound for a worker that is not blocked.
  virtual absl::Status ReadmitWorker(const std::string& name) = 0;
  /// By name.
  virtual absl::StatusOr<std::vector<BlockedWorker>> BlockedWorkers() = 0;
};

/// The error of a caller that has lost a job to another owner: kAborted naming both epochs.
absl::Status OtherOwner(const job::JobId& job, Epoch owner, Epoch caller);

/// Looks whether the caller still owns the job, before it writes what the store does not hold: a file of a
/// folder that several coordinators share. The file can still be late by the time between the look and the
/// write.
/// Errors: kAborted; kNotFound.
absl::Status CheckOwner(JobStore& store, const OwnedJob& job);

}  // namespace lumifold::ledger
