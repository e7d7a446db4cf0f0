#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/accepted_unit.h"
#include "server/commit/open_logs.h"
#include "server/film/unit_log.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// The unit logs of the frames that one coordinator writes: opens them where the ledger says that they end,
/// appends units, and takes back units whose records cannot be read.
/// Threads: one at a time.
class FrameLogs {
 public:
  using LostUnits = absl::StatusOr<std::vector<ledger::UnitRecord>>;
  struct Options {
    /// In which this coordinator owns its jobs.
    ledger::Epoch epoch;
    size_t max_open = 256;
    /// A log that was to be opened is shorter than the ledger says: `lost` units of it were taken back.
    std::function<void(const FrameKey& frame, const absl::Status& cause, const LostUnits& lost)> on_lost;
  };
  /// `store` must outlive it.
  FrameLogs(Options options, const DataFolder& folder, ledger::JobStore* store)
      : options_(std::move(options)), folder_(folder), store_(store), open_(options_.max_open) {}

  /// Sets the size of a frame's log according to the ledger.
  void Restore(const FrameKey& frame, uint64_t committed_bytes) { committed_bytes_[frame] = committed_bytes; }
  /// Appends units of one job to the logs of their frames and syncs these; their records for the ledger.
  /// After an error the content of these logs is not known: call CloseAll.
  absl::StatusOr<std::vector<ledger::UnitRecord>> Write(const job::JobId& job,
                                                        std::vector<AcceptedUnit>* units);
  /// The ledger has the unit.
  void OnCommitted(const job::JobId& job, const ledger::UnitRecord& record);
  /// The next write begins at the committed ends.
  void CloseAll(const job::JobId& job) { open_.CloseAll(job); }

  /// Takes back the committed units of a frame whose records cannot be read, and returns them. A try whose
  /// outcome is not known is repeated.
  LostUnits TakeBackLost(const FrameKey& frame);
  /// Makes records of a frame unreadable.
  absl::Status Void(const FrameKey& frame, const std::vector<job::UnitKey>& units);

  /// Forgets the log of a finished frame, or all logs of a job that has ended, so that they can be deleted.
  void Forget(const FrameKey& frame);
  void ForgetLogs(const job::JobId& job);
  /// The same, of a job that will be written again.
  void ForgetJob(const job::JobId& job);

 private:
  absl::Status WriteOne(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
                        std::vector<ledger::UnitRecord>* records);
  absl::Status AppendAndSync(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
                             std::vector<ledger::UnitRecord>* records);
  /// Counts an error of the disk with a log, and begins a new log after some. The error that is to be tried
  /// again.
  absl::Status NoteWriteError(const FrameKey& frame, const absl::Status& cause);
  absl::Status RecordClass(const job::JobId& job, const std::string& numeric_class);
  absl::StatusOr<film::UnitLog*> LogOf(const FrameKey& frame);
  absl::StatusOr<film::UnitLog> Open(const FrameKey& frame) const;

  const Options options_;
  const DataFolder folder_;
  ledger::JobStore* const store_;
  OpenLogs open_;
  std::map<FrameKey, uint64_t> committed_bytes_;  // of logs that have committed units
  std::set<job::JobId> classes_recorded_;
  /// Lost units until the ledger is known not to have them.
  std::map<FrameKey, std::map<job::UnitKey, ledger::UnitRecord>> being_revoked_;
  /// Errors of the disk with a log since it was last written.
  std::map<FrameKey, int> write_errors_;
};

}  // namespace lumifold::server
