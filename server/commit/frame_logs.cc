#include "server/commit/frame_logs.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "server/film/void_records.h"
#include "server/storage/manifest.h"
#include "server/storage/storage_state.h"

namespace lumifold::server {
namespace {

/// A log with which the disk has failed this often in succession is set aside, with a pause after each
/// failure: an error that goes away by itself must not cost a frame. Its file stays until the film is
/// deleted.
constexpr int kMaxWriteErrors = 3;
constexpr char kBrokenSuffix[] = ".broken";

ledger::UnitRecord RecordOf(const AcceptedUnit& unit, const std::string& log,
                            const film::RecordPlace& place) {
  return {.unit = unit.stored.unit,
          .attempt = unit.stored.attempt,
          .worker = unit.worker_name,
          .file = log,
          .offset = place.offset,
          .length = place.length,
          .samples = unit.samples,
          .bad_samples = unit.stored.stats.bad_samples(),
          .cost = ledger::UnitCost{unit.accepted, unit.stored.stats.seconds()}};
}

/// Whether a unit's record has its pixels undamaged.
bool CanBeRead(const film::UnitLogReader& log, const ledger::UnitRecord& record) {
  const absl::StatusOr<film::StoredUnit> unit = log.Read({record.offset, record.length});
  return unit.ok() && unit->unit == record.unit;
}

}  // namespace

absl::StatusOr<std::vector<ledger::UnitRecord>> FrameLogs::Write(const job::JobId& job,
                                                                 std::vector<AcceptedUnit>* units) {
  if (absl::Status status = RecordClass(job, units->front().numeric_class); !status.ok()) return status;
  std::map<int32_t, std::vector<AcceptedUnit*>> by_frame;
  for (AcceptedUnit& unit : *units) by_frame[unit.stored.unit.key.frame].push_back(&unit);
  std::vector<ledger::UnitRecord> records;
  for (const auto& [frame, of_frame] : by_frame) {
    const absl::Status status = WriteOne({job, frame}, of_frame, &records);
    if (!status.ok()) return status;
  }
  return records;
}

absl::Status FrameLogs::WriteOne(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
                                 std::vector<ledger::UnitRecord>* records) {
  const absl::Status status = AppendAndSync(frame, units, records);
  if (absl::IsDataLoss(status)) return NoteWriteError(frame, status);
  if (status.ok()) write_errors_.erase(frame);
  return status;
}

absl::Status FrameLogs::NoteWriteError(const FrameKey& frame, const absl::Status& cause) {
  const absl::Status again = absl::UnavailableError(cause.message());
  if (++write_errors_[frame] < kMaxWriteErrors) return again;
  open_.Close(frame);
  const std::string path = folder_.PathOf(folder_.UnitLogName(frame.first, frame.second));
  if (folder_.files()->Rename(path, path + kBrokenSuffix) != 0) return again;
  write_errors_.erase(frame);
  return again;  // the next try makes a new log, and finds that the units of the old one are lost
}

absl::Status FrameLogs::AppendAndSync(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
                                      std::vector<ledger::UnitRecord>* records) {
  const absl::StatusOr<film::UnitLog*> log = LogOf(frame);
  if (!log.ok()) return log.status();
  for (AcceptedUnit* unit : units) {
    const absl::StatusOr<film::RecordPlace> place = (*log)->Append(unit->stored);
    if (!place.ok()) return place.status();
    unit->record_bytes = place->length;
    records->push_back(RecordOf(*unit, folder_.UnitLogName(frame.first, frame.second), *place));
  }
  return (*log)->Sync();
}

absl::Status FrameLogs::RecordClass(const job::JobId& job, const std::string& numeric_class) {
  if (classes_recorded_.contains(job)) return absl::OkStatus();
  if (absl::Status status = MakeFolder(folder_.FilmPath(job), folder_.files()); !status.ok()) return status;
  if (ReadNumericClass(folder_, job) != numeric_class) {
    if (absl::Status status = WriteNumericClass(folder_, job, numeric_class); !status.ok()) return status;
  }
  classes_recorded_.insert(job);
  return absl::OkStatus();
}

absl::StatusOr<film::UnitLog*> FrameLogs::LogOf(const FrameKey& frame) {
  return open_.Get(frame, [&]() -> absl::StatusOr<film::UnitLog> {
    absl::StatusOr<film::UnitLog> log = Open(frame);
    if (!absl::IsDataLoss(log.status())) return log;
    const LostUnits lost = TakeBackLost(frame);
    if (!lost.ok()) return lost.status();
    options_.on_lost(frame, log.status(), lost);
    return Open(frame);
  });
}

absl::StatusOr<film::UnitLog> FrameLogs::Open(const FrameKey& frame) const {
  const auto committed = committed_bytes_.find(frame);
  return film::UnitLog::Open(folder_.PathOf(folder_.UnitLogName(frame.first, frame.second)),
                             committed == committed_bytes_.end() ? 0 : committed->second, folder_.files());
}

void FrameLogs::OnCommitted(const job::JobId& job, const ledger::UnitRecord& record) {
  uint64_t& end = committed_bytes_[{job, record.unit.key.frame}];
  end = std::max(end, record.offset + record.length);
}

FrameLogs::LostUnits FrameLogs::TakeBackLost(const FrameKey& frame) {
  const auto& [job, number] = frame;
  open_.Close(frame);  // its file may have been deleted: the next unit opens or creates it
  // The ledger is free for others while the logs are read.
  std::vector<ledger::UnitRecord> units;
  const absl::Status listed = store_->ForEachUnit(
      job, number, [&units](const ledger::UnitRecord& record) { units.push_back(record); });
  if (!listed.ok()) return listed;
  std::map<job::UnitKey, ledger::UnitRecord>& lost = being_revoked_[frame];
  const std::string own_log = folder_.UnitLogName(job, number);
  std::map<std::string, absl::StatusOr<film::UnitLogReader>> logs;
  uint64_t committed_bytes = 0;
  for (ledger::UnitRecord& record : units) {
    auto log = logs.find(record.file);
    if (log == logs.end())
      log = logs.emplace(record.file, film::UnitLogReader::Open(folder_.PathOf(record.file))).first;
    if (!log->second.ok() && !absl::IsNotFound(log->second.status())) return log->second.status();
    if (!log->second.ok() || !CanBeRead(*log->second, record)) {
      lost[record.unit.key] = std::move(record);
    } else if (record.file == own_log) {
      committed_bytes = std::max(committed_bytes, record.offset + record.length);
    }
  }
  std::vector<job::UnitKey> keys;
  for (const auto& [key, record] : lost) keys.push_back(key);
  const absl::Status revoked = store_->RevokeUnits({job, options_.epoch}, keys);
  if (IsStorageError(revoked)) return revoked;
  std::vector<ledger::UnitRecord> records;
  for (auto& [key, record] : lost) records.push_back(std::move(record));
  being_revoked_.erase(frame);
  if (!revoked.ok()) return revoked;
  committed_bytes_[frame] = committed_bytes;
  return records;
}

absl::Status FrameLogs::Void(const FrameKey& frame, const std::vector<job::UnitKey>& units) {
  const std::set<job::UnitKey> discarded(units.begin(), units.end());
  std::map<std::string, std::vector<film::RecordPlace>> places;  // by log
  const absl::Status listed =
      store_->ForEachUnit(frame.first, frame.second, [&](const ledger::UnitRecord& record) {
        if (discarded.contains(record.unit.key))
          places[record.file].push_back({record.offset, record.length});
      });
  if (!listed.ok()) return listed;
  for (const auto& [log, of_log] : places) {
    const absl::Status status = film::VoidRecords(folder_.PathOf(log), of_log, folder_.files());
    if (!status.ok() && !absl::IsNotFound(status)) return status;
  }
  return absl::OkStatus();
}

void FrameLogs::Forget(const FrameKey& frame) {
  open_.Close(frame);
  committed_bytes_.erase(frame);
  write_errors_.erase(frame);
}

void FrameLogs::ForgetLogs(const job::JobId& job) {
  open_.CloseAll(job);
  const auto is_of_job = [&job](const auto& entry) { return entry.first.first == job; };
  std::erase_if(committed_bytes_, is_of_job);
  std::erase_if(write_errors_, is_of_job);
  classes_recorded_.erase(job);
}

void FrameLogs::ForgetJob(const job::JobId& job) {
  ForgetLogs(job);
  std::erase_if(being_revoked_, [&job](const auto& entry) { return entry.first.first == job; });
}

}  // namespace lumifold::server
