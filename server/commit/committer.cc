#include "server/commit/committer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>

#include "server/film/void_records.h"
#include "server/storage/manifest.h"

namespace lumifold::server {
namespace {

/// Maximum number of units in a batch. Limits the memory of a batch and the delay of acknowledgements.
constexpr size_t kMaxBatch = 256;
/// A log with which the disk has failed this often in succession is set aside, with a pause after each
/// failure: an error that goes away by itself must not cost a frame. Its file stays until the film is
/// deleted.
constexpr int kMaxWriteErrors = 3;
constexpr char kBrokenSuffix[] = ".broken";
constexpr double kPauseGrowth = 2;
constexpr int kMaxGrowths = 60;  // further ones would overflow
/// Maximum time between two looks at the clock: options_.now may not be the clock that waits use.
constexpr absl::Duration kIdleInterval = absl::Seconds(1);

ledger::UnitRecord RecordOf(const AcceptedUnit& unit, const std::string& log,
                            const film::RecordPlace& place) {
  return {.unit = unit.stored.unit,
          .attempt = unit.stored.attempt,
          .worker = unit.worker_name,
          .file = log,
          .offset = place.offset,
          .length = place.length,
          .samples = unit.samples,
          .bad_samples = unit.stored.stats.bad_samples()};
}

/// Whether a unit's record has its pixels undamaged.
bool CanBeRead(const film::UnitLogReader& log, const ledger::UnitRecord& record) {
  const absl::StatusOr<film::StoredUnit> unit = log.Read({record.offset, record.length});
  return unit.ok() && unit->unit == record.unit;
}

/// The commit of `units`, all of one job, without their records.
ledger::JobCommit CommitOf(const std::vector<AcceptedUnit>& units, ledger::Epoch epoch) {
  ledger::JobCommit commit;
  commit.job = {units.front().stored.unit.job, epoch};
  commit.numeric_class = units.front().numeric_class;
  commit.started = units.front().started;
  for (const AcceptedUnit& unit : units) {
    const auto& warnings = unit.stored.stats.warnings();
    commit.warnings.insert(commit.warnings.end(), warnings.begin(), warnings.end());
  }
  return commit;
}

}  // namespace

Committer::Committer(const CommitterOptions& options, const DataFolder& folder, ledger::JobStore* store,
                     StorageState* storage, monitoring::FarmTimings* timings, Listener* listener)
    : options_(options),
      folder_(folder),
      store_(store),
      storage_(storage),
      timings_(timings),
      listener_(listener),
      logs_(options.max_open_logs),
      reserve_(folder.ReservePath(), options.reserve_bytes, folder.files()) {
  storage_->OnFail([this] {
    absl::MutexLock lock(&mutex_);
    storage_failed_ = true;
  });
}

Committer::~Committer() { Stop(); }

void Committer::RestoreLog(const FrameKey& frame, uint64_t committed_bytes) {
  committed_bytes_[frame] = committed_bytes;
}

void Committer::Start() {
  thread_ = std::thread([this] { Run(); });
}

void Committer::Enqueue(AcceptedUnit unit) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) units_.push_back(std::move(unit));
}

void Committer::Write(std::function<absl::Status()> write, std::function<void(const absl::Status&)> done) {
  {
    absl::MutexLock lock(&mutex_);
    if (!stopping_) orders_.push_back({std::move(write), std::move(done)});
    has_new_order_ = true;
  }
  wake_up_.Notify();
}

void Committer::Check(const FrameKey& frame, const absl::Status& cause) {
  using Lost = absl::StatusOr<std::vector<ledger::UnitRecord>>;
  const auto lost = std::make_shared<Lost>();
  Write(
      [this, frame, lost] {
        *lost = listener_->IsWanted(frame.first) ? TakeBackLostUnits(frame) : Lost(absl::CancelledError(""));
        return lost->status();
      },
      [this, frame, cause, lost](const absl::Status&) {
        if (listener_->IsWanted(frame.first)) listener_->OnUnitsLost(frame.first, frame.second, cause, *lost);
      });
}

void Committer::Discard(const FrameKey& frame, const std::vector<job::UnitKey>& units) {
  using Lost = absl::StatusOr<std::vector<ledger::UnitRecord>>;
  const auto lost = std::make_shared<Lost>();
  Write(
      [this, frame, units, lost] {
        if (!listener_->IsWanted(frame.first)) return absl::CancelledError("");
        // First the records: a crash in between leaves rows without records, which are found and rendered
        // again.
        if (absl::Status status = VoidRecordsOf(frame, units); !status.ok()) return status;
        *lost = TakeBackLostUnits(frame);
        return lost->status();
      },
      [this, frame, units, lost](const absl::Status&) {
        if (listener_->IsWanted(frame.first)) listener_->OnUnitsDiscarded(frame, units, *lost);
      });
}

absl::Status Committer::VoidRecordsOf(const FrameKey& frame, const std::vector<job::UnitKey>& units) {
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

void Committer::ForgetLog(const FrameKey& frame) {
  logs_.Close(frame);
  committed_bytes_.erase(frame);
}

void Committer::ForgetLogs(const job::JobId& job) {
  logs_.CloseAll(job);
  const auto first = committed_bytes_.lower_bound({job, std::numeric_limits<int32_t>::min()});
  auto last = first;
  while (last != committed_bytes_.end() && last->first.first == job) ++last;
  committed_bytes_.erase(first, last);
  classes_recorded_.erase(job);
  std::erase_if(write_errors_, [&job](const auto& entry) { return entry.first.first == job; });
}

void Committer::ForgetJob(const job::JobId& job) {
  ForgetLogs(job);
  batch_.erase(job);
  std::erase_if(being_revoked_, [&job](const auto& entry) { return entry.first.first == job; });
  absl::MutexLock lock(&mutex_);
  std::erase_if(units_, [&job](const AcceptedUnit& unit) { return unit.stored.unit.job == job; });
}

void Committer::Stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  wake_up_.Notify();
  if (thread_.joinable()) thread_.join();
}

void Committer::Run() {
  while (AwaitWork()) {
    const absl::Status status = WriteWaiting();
    if (!status.ok()) {
      storage_->Fail(status);
      reserve_.GiveUp();
      if (!Pause()) return;  // what waits was not acknowledged
      continue;
    }
    failures_ = 0;
    if (storage_->ok()) continue;
    storage_->Recover();
    listener_->OnStorageAvailable();
  }
}

bool Committer::HasWork() const {
  return stopping_ || storage_failed_ || !orders_.empty() || !units_.empty();
}

bool Committer::AwaitWork() {
  if (!batch_.empty()) return true;  // it is tried again
  bool pauses = false;
  {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &Committer::HasWork));
    if (stopping_ && orders_.empty() && units_.empty()) return false;
    pauses = std::exchange(storage_failed_, false) && failures_ == 0;
  }
  if (pauses) {  // others have noticed that the storage cannot be written
    reserve_.GiveUp();
    Pause();
  }
  return true;
}

bool Committer::EndsPause() {
  absl::MutexLock lock(&mutex_);
  return stopping_ || has_new_order_;
}

bool Committer::Pause() {
  const double growth = std::pow(kPauseGrowth, std::min(failures_, kMaxGrowths));
  ++failures_;
  const absl::Time end = options_.now() + std::min(options_.longest_pause, options_.first_pause * growth);
  for (absl::Time now = options_.now(); now < end && !EndsPause(); now = options_.now())
    wake_up_.Consume(std::min(end - now, kIdleInterval));
  absl::MutexLock lock(&mutex_);
  return !stopping_;
}

absl::Status Committer::WriteWaiting() {
  if (absl::Status status = CarryOutOrders(); !status.ok()) return status;
  if (absl::Status status = reserve_.Take(); !status.ok()) return status;
  if (!storage_->ok()) {
    // Without anything to write, this tells whether the ledger answers.
    const absl::Status reached = store_->GetJob(job::JobId()).status();
    if (IsStorageError(reached)) return reached;
  }
  return CommitBatch();
}

absl::Status Committer::CarryOutOrders() {
  while (true) {
    Order order;
    {
      absl::MutexLock lock(&mutex_);
      has_new_order_ = false;
      if (orders_.empty()) return absl::OkStatus();
      order = orders_.front();
    }
    const absl::Status status = order.write();
    if (IsStorageError(status)) return status;
    {
      absl::MutexLock lock(&mutex_);
      orders_.pop_front();
    }
    order.done(status);
  }
}

void Committer::FillBatch() {
  absl::MutexLock lock(&mutex_);
  const size_t count = std::min(units_.size(), kMaxBatch);
  for (size_t i = 0; i < count; ++i) {
    batch_[units_.front().stored.unit.job].units.push_back(std::move(units_.front()));
    units_.pop_front();
  }
  batch_is_synced_ = false;
}

absl::Status Committer::CommitBatch() {
  if (batch_.empty()) FillBatch();
  std::erase_if(batch_, [this](const auto& entry) { return !listener_->IsWanted(entry.first); });
  if (!batch_is_synced_) {
    if (absl::Status status = WriteLogs(); !status.ok()) {
      // What is in the files is not known: the next try begins at their committed ends.
      for (const auto& [job, batch] : batch_) logs_.CloseAll(job);
      return status;
    }
    batch_is_synced_ = true;
  }
  std::vector<ledger::JobCommit> commits;
  for (const auto& [job, batch] : batch_) {
    if (batch.error.ok()) commits.push_back(batch.commit);
  }
  std::vector<absl::Status> outcomes;
  if (!commits.empty()) {
    const absl::Time start = options_.now();
    absl::StatusOr<std::vector<absl::Status>> committed = store_->CommitUnits(commits);
    timings_->ObserveCommit(options_.now() - start);
    if (!committed.ok()) return committed.status();
    outcomes = *std::move(committed);
  }
  Report(std::exchange(batch_, {}), outcomes);
  return absl::OkStatus();
}

void Committer::Report(Batch batch, const std::vector<absl::Status>& outcomes) {
  auto next = outcomes.begin();
  for (auto& [job, of_job] : batch) {
    const absl::Status status = of_job.error.ok() ? *next++ : of_job.error;
    for (const ledger::UnitRecord& record : of_job.commit.units) {
      if (!status.ok()) break;
      uint64_t& end = committed_bytes_[{job, record.unit.key.frame}];
      end = std::max(end, record.offset + record.length);
    }
    // What was written for the job is no longer wanted.
    if (!status.ok()) ForgetLogs(job);
    listener_->OnCommitted(of_job.units, status);
  }
}

absl::Status Committer::WriteLogs() {
  for (auto& [job, batch] : batch_) {
    batch.commit = CommitOf(batch.units, options_.epoch);
    batch.error = WriteLogs(job, &batch);
    if (IsStorageError(batch.error)) return std::exchange(batch.error, absl::OkStatus());
  }
  return absl::OkStatus();
}

absl::Status Committer::WriteLogs(const job::JobId& job, JobBatch* batch) {
  if (absl::Status status = RecordClass(job, batch->commit.numeric_class); !status.ok()) return status;
  std::map<int32_t, std::vector<AcceptedUnit*>> by_frame;
  for (AcceptedUnit& unit : batch->units) by_frame[unit.stored.unit.key.frame].push_back(&unit);
  for (const auto& [frame, units] : by_frame) {
    const absl::Status status = WriteLog({job, frame}, units, &batch->commit.units);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status Committer::WriteLog(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
                                 std::vector<ledger::UnitRecord>* records) {
  const absl::Status status = AppendAndSync(frame, units, records);
  if (absl::IsDataLoss(status)) return SetAsideBrokenLog(frame, status);
  if (status.ok()) write_errors_.erase(frame);
  return status;
}

absl::Status Committer::SetAsideBrokenLog(const FrameKey& frame, const absl::Status& cause) {
  const absl::Status again = absl::UnavailableError(cause.message());
  if (++write_errors_[frame] < kMaxWriteErrors) return again;
  logs_.Close(frame);
  const std::string path = folder_.PathOf(folder_.UnitLogName(frame.first, frame.second));
  if (folder_.files()->Rename(path, path + kBrokenSuffix) != 0) return again;
  write_errors_.erase(frame);
  return again;  // the next try makes a new log, and finds that the units of the old one are lost
}

absl::Status Committer::AppendAndSync(const FrameKey& frame, const std::vector<AcceptedUnit*>& units,
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

absl::Status Committer::RecordClass(const job::JobId& job, const std::string& numeric_class) {
  if (classes_recorded_.contains(job)) return absl::OkStatus();
  if (absl::Status status = MakeFolder(folder_.FilmPath(job), folder_.files()); !status.ok()) return status;
  if (ReadNumericClass(folder_, job) != numeric_class) {
    if (absl::Status status = WriteNumericClass(folder_, job, numeric_class); !status.ok()) return status;
  }
  classes_recorded_.insert(job);
  return absl::OkStatus();
}

absl::StatusOr<film::UnitLog*> Committer::LogOf(const FrameKey& frame) {
  return logs_.Get(frame, [&]() -> absl::StatusOr<film::UnitLog> {
    absl::StatusOr<film::UnitLog> log = OpenLog(frame);
    if (!absl::IsDataLoss(log.status())) return log;
    // It is shorter than the ledger says.
    const absl::StatusOr<std::vector<ledger::UnitRecord>> lost = TakeBackLostUnits(frame);
    if (!lost.ok()) return lost.status();
    listener_->OnUnitsLost(frame.first, frame.second, log.status(), lost);
    return OpenLog(frame);
  });
}

absl::StatusOr<film::UnitLog> Committer::OpenLog(const FrameKey& frame) {
  const auto committed = committed_bytes_.find(frame);
  return film::UnitLog::Open(folder_.PathOf(folder_.UnitLogName(frame.first, frame.second)),
                             committed == committed_bytes_.end() ? 0 : committed->second, folder_.files());
}

absl::StatusOr<std::vector<ledger::UnitRecord>> Committer::TakeBackLostUnits(const FrameKey& frame) {
  const auto& [job, number] = frame;
  logs_.Close(frame);  // its file may have been deleted: the next unit opens or creates it
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

}  // namespace lumifold::server
