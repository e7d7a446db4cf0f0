#include "server/commit/restore_units.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "server/film/unit_log.h"
#include "server/job/tile_grid.h"
#include "server/storage/folder_contents.h"
#include "server/storage/manifest.h"

namespace lumifold::server {
namespace {

/// Units that are committed in one transaction. Limits its memory.
constexpr size_t kMaxCommit = 1000;

/// Commits the records that a log of a frame has beyond the ledger.
class LogTail {
 public:
  LogTail(const DataFolder& folder, ledger::JobStore& store, const ledger::OwnedJob& job,
          const ledger::JobRecord& record, std::optional<absl::Time> now, int32_t frame, std::string name)
      : store_(store),
        counted_(record.counted),
        now_(now),
        units_(record.spec),
        frame_(frame),
        name_(std::move(name)),
        path_(folder.PathOf(name_)) {
    commit_.job = job;
    commit_.started = record.started;
    commit_.recovered = true;
    // The class file is written before the first record.
    commit_.numeric_class =
        record.numeric_class.empty() ? ReadNumericClass(folder, job.job) : record.numeric_class;
  }

  /// Returns the end of the last undamaged record from `first` on.
  absl::StatusOr<uint64_t> Commit(uint64_t first, absl::FunctionRef<void(const ledger::UnitRecord&)> visit) {
    if (commit_.numeric_class.empty()) return first;
    const absl::StatusOr<film::UnitLogReader> log = film::UnitLogReader::Open(path_);
    if (!log.ok()) return log.status();
    const absl::Status listed =
        store_.ForEachUnit(commit_.job.job, frame_,
                           [this](const ledger::UnitRecord& unit) { committed_.insert(unit.unit.key); });
    if (!listed.ok()) return listed;
    absl::Status status;
    const absl::StatusOr<uint64_t> end =
        log->Scan(first, [&](const film::StoredUnit& unit, const film::RecordPlace& place) {
          if (status.ok()) status = Add(unit, place, visit);
        });
    if (!end.ok()) return end.status();
    if (status.ok()) status = Flush(visit);
    if (!status.ok()) return status;
    return *end;
  }

  int64_t recovered() const { return recovered_; }

 private:
  absl::Status Add(const film::StoredUnit& unit, const film::RecordPlace& place,
                   absl::FunctionRef<void(const ledger::UnitRecord&)> visit) {
    const job::UnitKey& key = unit.unit.key;
    const bool is_of_frame = unit.unit.job == commit_.job.job && key.frame == frame_;
    if (!is_of_frame || !units_.NumberOf(key).has_value() || !committed_.insert(key).second)
      return absl::OkStatus();
    ledger::UnitRecord& record = commit_.units.emplace_back();
    record.unit = unit.unit;
    record.attempt = unit.attempt;
    record.file = name_;
    record.offset = place.offset;
    record.length = place.length;
    record.samples = units_.is_adaptive() ? unit.stats.samples() : units_.CameraSamplesOf(key);
    record.bad_samples = unit.stats.bad_samples();
    if (now_.has_value() && unit.attempt >= counted_)
      record.cost = ledger::UnitCost{*now_, unit.stats.seconds()};
    commit_.warnings.insert(commit_.warnings.end(), unit.stats.warnings().begin(),
                            unit.stats.warnings().end());
    return commit_.units.size() < kMaxCommit ? absl::OkStatus() : Flush(visit);
  }

  absl::Status Flush(absl::FunctionRef<void(const ledger::UnitRecord&)> visit) {
    if (commit_.units.empty()) return absl::OkStatus();
    const absl::StatusOr<std::vector<absl::Status>> outcomes = store_.CommitUnits({commit_});
    if (!outcomes.ok()) return outcomes.status();
    if (!outcomes->front().ok()) return outcomes->front();
    for (const ledger::UnitRecord& record : commit_.units) visit(record);
    recovered_ += static_cast<int64_t>(commit_.units.size());
    commit_.units.clear();
    commit_.warnings.clear();
    return absl::OkStatus();
  }

  ledger::JobStore& store_;
  const job::Attempt counted_;
  const std::optional<absl::Time> now_;
  const job::FrameUnits units_;
  const int32_t frame_;
  const std::string name_;
  const std::string path_;
  ledger::JobCommit commit_;
  std::set<job::UnitKey> committed_;
  int64_t recovered_ = 0;
};

}  // namespace

absl::StatusOr<RestoredUnits> RestoreUnits(const DataFolder& folder, ledger::JobStore& store,
                                           const ledger::OwnedJob& job, const ledger::JobRecord& record,
                                           const std::vector<int32_t>& finished,
                                           std::optional<absl::Time> now,
                                           absl::FunctionRef<void(const ledger::UnitRecord&)> visit) {
  RestoredUnits restored;
  std::map<std::string, uint64_t> ends;  // of the committed records, by log
  const absl::Status read = store.ForEachUnit(job.job, std::nullopt, [&](const ledger::UnitRecord& unit) {
    visit(unit);
    restored.frames.insert(unit.unit.key.frame);
    uint64_t& end = ends[unit.file];
    end = std::max(end, unit.offset + unit.length);
    if (unit.file == folder.UnitLogName(job.job, unit.unit.key.frame))
      restored.committed_bytes[unit.unit.key.frame] = end;
  });
  if (!read.ok()) return read;
  for (const auto& [frame, name, bytes] : UnitLogsOf(folder, job.job)) {
    const uint64_t first = ends[name];
    if (bytes <= first || std::binary_search(finished.begin(), finished.end(), frame)) continue;
    LogTail tail(folder, store, job, record, now, frame, name);
    const absl::StatusOr<uint64_t> end = tail.Commit(first, visit);
    if (!end.ok()) return end.status();
    restored.frames.insert(frame);
    if (name == folder.UnitLogName(job.job, frame)) restored.committed_bytes[frame] = *end;
    restored.recovered += tail.recovered();
  }
  return restored;
}

}  // namespace lumifold::server
