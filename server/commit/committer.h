#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/retry/pauses.h"
#include "proto/retry/schedule.h"
#include "server/commit/accepted_unit.h"
#include "server/commit/commit_queue.h"
#include "server/commit/frame_logs.h"
#include "server/ledger/job_store.h"
#include "server/metrics/farm_timings.h"
#include "server/storage/data_folder.h"
#include "server/storage/reserve_file.h"
#include "server/storage/storage_options.h"
#include "server/storage/storage_state.h"

namespace lumifold::server {

struct CommitterOptions {
  /// Epoch in which this coordinator owns its jobs.
  ledger::Epoch epoch;
  /// Monotonic clock.
  std::function<absl::Time()> now;
  StorageOptions storage;
};

/// Does all writing that the state of jobs depends on, on a thread of its own. Commits accepted units in
/// groups: appends them to the unit logs of their frames, syncs each log once, then records the units of all
/// jobs in one transaction of the ledger. Only then may a unit be acknowledged.
///
/// Errors of the storage never reach a job: what could not be written is kept and tried again with growing
/// pauses, and the StorageState says so. A log that alone cannot be written, again and again, is set aside: a
/// new one is begun, and what the old one had is rendered again. Meanwhile the reserve file is given up, so
/// that orders, which need little space, can still be recorded; units wait until the reserve is held again.
/// What waits is bounded by the slots of the workers, since a unit takes its worker's slot until it is
/// acknowledged, and by the active jobs and frames.
///
/// Threads: all calls from any thread; the listener and the functions of orders are called from the
/// committer's own thread, without a lock.
class Committer {
 public:
  /// Receives the outcome of commits.
  class Listener {
   public:
    virtual ~Listener() = default;
    /// Whether the job is active. Units of a job that has ended are dropped.
    virtual bool IsWanted(const job::JobId& job) = 0;
    /// The units, all of one job, are committed; or, if `status` is an error, none of them is committed and
    /// the job cannot continue. kAborted: the job belongs to another coordinator.
    virtual void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) = 0;
    /// The records of `lost` units of a frame could not be read, and the ledger no longer has them: they must
    /// be rendered again. `cause` is the error that led to the check. Empty `lost`: every committed unit can
    /// be read. An error: the job cannot continue.
    virtual void OnUnitsLost(const job::JobId& job, int32_t frame, const absl::Status& cause,
                             const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) = 0;
    /// Units of a frame were discarded: neither the ledger nor the log has them. `lost`: those, and others
    /// whose records could not be read. An error: the job cannot continue.
    virtual void OnUnitsDiscarded(const FrameKey& frame, const std::vector<job::UnitKey>& units,
                                  const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) = 0;
    /// The storage can be written again.
    virtual void OnStorageAvailable() = 0;
  };

  /// All arguments must outlive it. Nothing happens before Start.
  Committer(const CommitterOptions& options, const DataFolder& folder, ledger::JobStore* store,
            StorageState* storage, monitoring::FarmTimings* timings, Listener* listener);
  ~Committer();

  /// Sets the size of a frame's unit log according to the ledger. Call it before Start, or from the
  /// committer's thread.
  void RestoreLog(const FrameKey& frame, uint64_t committed_bytes);
  void Start();

  void Enqueue(AcceptedUnit unit);
  /// An order: calls `write` until it returns no storage error, then `done` with the outcome. Orders are
  /// carried out in order, and before units that wait. `write` may be called again after it has had an
  /// effect.
  void Write(std::function<absl::Status()> write, std::function<void(const absl::Status&)> done);
  /// Reads the log of a frame that is not finished, takes back the units whose records cannot be read, and
  /// calls OnUnitsLost. No unit of the frame may be queued.
  void Check(const FrameKey& frame, const absl::Status& cause);
  /// Takes committed units of a frame that is not finished out of its log and the ledger, and calls
  /// OnUnitsDiscarded. No effect on a frame that the listener does not want any more.
  void Discard(const FrameKey& frame, const std::vector<job::UnitKey>& units);
  /// Forgets the log of a finished frame, or all logs of a job that has ended, so that they can be deleted.
  /// Call it from the committer's thread.
  void ForgetLog(const FrameKey& frame);
  void ForgetLogs(const job::JobId& job);

  /// Forgets everything of a job that the scheduler no longer has: its logs, and units that were accepted and
  /// are not committed. Call it from the committer's thread.
  void ForgetJob(const job::JobId& job);

  /// Writes what is queued, unless the storage cannot be written, then stops. Later calls have no effect.
  void Stop();

 private:
  /// The units of one job that are being committed.
  struct JobBatch {
    std::vector<AcceptedUnit> units;
    ledger::JobCommit commit;
    /// Its log cannot be used: the job cannot continue.
    absl::Status error;
  };
  using Batch = std::map<job::JobId, JobBatch>;

  void Run();
  /// Waits until there is something to do; false when the committer is to end.
  bool AwaitWork();
  /// Waits after an error of the storage, until there is a new order at most; false when the committer is to
  /// end.
  bool Pause();
  /// Tries everything that waits once. Errors: one of the storage.
  absl::Status WriteWaiting();
  absl::Status CarryOutOrders();
  absl::Status CommitBatch();
  /// Writes the units of the batch to their logs, and syncs these.
  absl::Status WriteLogs();
  void Report(Batch batch, const std::vector<absl::Status>& outcomes);

  const CommitterOptions options_;
  ledger::JobStore* const store_;
  StorageState* const storage_;
  monitoring::FarmTimings* const timings_;
  Listener* const listener_;
  CommitQueue queue_;

  // Used by the committer's thread only, and before it starts.
  FrameLogs logs_;
  ReserveFile reserve_;
  Batch batch_;
  bool batch_is_synced_ = false;
  retry::Schedule pauses_;  // its failures: errors of the storage since the last success

  std::thread thread_;
};

}  // namespace lumifold::server
