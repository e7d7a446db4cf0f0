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
#include "absl/synchronization/mutex.h"
#include "server/data_folder.h"
#include "server/film/unit_log.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// A unit that has been accepted and is to be made durable.
struct AcceptedUnit {
  film::StoredUnit stored;
  scheduler::WorkerId worker;
  /// Camera samples, as the scheduler counts them.
  int64_t samples = 0;
  /// For the job's row: the class it is bound to and when its first lease was given.
  std::string numeric_class;
  absl::Time started;
};

/// Makes accepted units durable, many at a time: appends them to their frames' unit logs, syncs each log
/// once, then records them in one transaction of the ledger. Only then may a unit be acknowledged.
/// Threads: all calls from any thread; the listener is called from the committer's own.
class Committer {
 public:
  /// What the committer asks and tells.
  class Listener {
   public:
    virtual ~Listener() = default;
    /// False once the job has ended: its units are dropped.
    virtual bool IsWanted(const scheduler::JobId& job) = 0;
    /// The units, all of one job, are durable; or, where `status` is an error, none of them is and none can
    /// be.
    virtual void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) = 0;
  };

  /// All three must outlive it.
  Committer(const DataFolder& folder, ledger::JobStore* store, Listener* listener);
  ~Committer();

  /// Says how much of a frame's unit log the ledger knew of at the start. Before any unit of the frame.
  void RestoreLog(const scheduler::JobId& job, int32_t frame, uint64_t committed_bytes);
  void Enqueue(AcceptedUnit unit);
  /// Deletes the unit logs of a frame that is finished, or of a job that has ended. Units of it still queued
  /// are stored first.
  void Discard(const scheduler::JobId& job, std::optional<int32_t> frame);
  /// Stores what is queued, then stops. Later calls do nothing.
  void Stop();

 private:
  struct DiscardOrder {
    scheduler::JobId job;
    std::optional<int32_t> frame;
  };
  using Task = std::variant<AcceptedUnit, DiscardOrder>;
  using FrameKey = std::pair<scheduler::JobId, int32_t>;

  void Run();
  bool HasWork() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return stopping_ || !queue_.empty(); }
  std::deque<Task> TakeTasks();
  void Commit(std::vector<AcceptedUnit> units);
  absl::Status Store(const std::vector<AcceptedUnit>& units);
  absl::StatusOr<film::UnitLog*> LogOf(const FrameKey& key);
  void Execute(const DiscardOrder& order);

  const DataFolder folder_;
  ledger::JobStore* const store_;
  Listener* const listener_;

  std::map<FrameKey, film::UnitLog> logs_;  // used by the committer's thread alone

  absl::Mutex mutex_;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Task> queue_ ABSL_GUARDED_BY(mutex_);
  std::map<FrameKey, uint64_t> committed_bytes_ ABSL_GUARDED_BY(mutex_);

  std::thread thread_;  // last: it uses all of the above
};

}  // namespace lumifold::server
