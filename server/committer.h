#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/data_folder.h"
#include "server/film/unit_log.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// An accepted unit that is to be committed.
struct AcceptedUnit {
  film::StoredUnit stored;
  job::WorkerId worker;
  /// Camera samples of the unit, as counted by the scheduler.
  int64_t samples = 0;
  /// For the row of the job: its numeric class and the time of its first lease.
  std::string numeric_class;
  absl::Time started;
};

/// Commits accepted units in batches: appends them to the unit logs of their frames, syncs each log once,
/// then records the units in one transaction of the ledger. Only then may a unit be acknowledged.
/// Threads: all calls from any thread; the listener is called from the committer's own thread.
class Committer {
 public:
  /// Receives the outcome of commits.
  class Listener {
   public:
    virtual ~Listener() = default;
    /// Whether the job is active. Units of a job that has ended are dropped.
    virtual bool IsWanted(const job::JobId& job) = 0;
    /// The units, all of one job, are committed; or, if `status` is an error, none of them is committed and
    /// the job cannot continue.
    virtual void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) = 0;
    /// The records of `lost` units of a frame could not be read, and the ledger no longer has them: they must be
    /// rendered again. `cause` is the error that led to the check. Empty `lost`: every committed unit can be read.
    /// An error: the job cannot continue.
    virtual void OnUnitsLost(const job::JobId& job, int32_t frame, const absl::Status& cause,
                             const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) = 0;
  };

  /// All arguments must outlive it.
  Committer(const DataFolder& folder, ledger::JobStore* store, Listener* listener);
  ~Committer();

  /// Sets the size of a frame's unit log according to the ledger. Call it before any unit of the frame.
  void RestoreLog(const job::JobId& job, int32_t frame, uint64_t committed_bytes);
  void Enqueue(AcceptedUnit unit);
  /// Deletes the unit log of a finished frame, or all unit logs of a job that has ended. Queued units are
  /// committed first.
  void Discard(const job::JobId& job, std::optional<int32_t> frame);
  /// Reads the log of a frame that is not finished, takes back the units whose records cannot be read, and calls
  /// OnUnitsLost. Queued units are committed first; later ones wait.
  void Check(const job::JobId& job, int32_t frame, const absl::Status& cause);
  /// Commits the queued units, then stops. Later calls have no effect.
  void Stop();

 private:
  struct DiscardOrder {
    job::JobId job;
    std::optional<int32_t> frame;
  };
  struct CheckOrder {
    job::JobId job;
    int32_t frame;
    absl::Status cause;
  };
  using Task = std::variant<AcceptedUnit, DiscardOrder, CheckOrder>;
  using FrameKey = std::pair<job::JobId, int32_t>;

  void Run();
  bool HasWork() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return stopping_ || !queue_.empty(); }
  std::deque<Task> TakeTasks();
  void Commit(std::vector<AcceptedUnit> units);
  absl::Status Store(const std::vector<AcceptedUnit>& units);
  absl::StatusOr<film::UnitLog*> LogOf(const FrameKey& key);
  absl::StatusOr<film::UnitLog> OpenLog(const FrameKey& key);
  absl::StatusOr<std::vector<ledger::UnitRecord>> TakeBackLostUnits(const FrameKey& key);
  void Execute(const DiscardOrder& order);
  void Execute(const CheckOrder& order);

  const DataFolder folder_;
  ledger::JobStore* const store_;
  Listener* const listener_;

  std::map<FrameKey, film::UnitLog> logs_;  // used by the committer's thread only

  absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Task> queue_ ABSL_GUARDED_BY(mutex_);
  std::map<FrameKey, uint64_t> committed_bytes_ ABSL_GUARDED_BY(mutex_);

  std::thread thread_;  // last member: it uses the members above
};

}  // namespace lumifold::server
