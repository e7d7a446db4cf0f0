#include "server/committer.h"

#include <algorithm>
#include <set>
#include <utility>

namespace lumifold::server {
namespace {

/// Maximum number of units in a batch. Limits the memory of a batch and the delay of acknowledgements.
constexpr size_t kMaxBatch = 256;

ledger::UnitRecord RecordOf(const AcceptedUnit& unit, const film::RecordPlace& place) {
  return {.unit = unit.stored.unit,
          .file = DataFolder::UnitLogName(unit.stored.unit.job, unit.stored.unit.key.frame),
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

/// Update of the job that all of `units` belong to.
ledger::JobUpdate UpdateOf(const std::vector<AcceptedUnit>& units) {
  ledger::JobUpdate update;
  update.job = units.front().stored.unit.job;
  update.numeric_class = units.front().numeric_class;
  update.started = units.front().started;
  for (const AcceptedUnit& unit : units) {
    const auto& warnings = unit.stored.stats.warnings();
    update.warnings.insert(update.warnings.end(), warnings.begin(), warnings.end());
  }
  return update;
}

}  // namespace

Committer::Committer(const DataFolder& folder, ledger::JobStore* store, Listener* listener)
    : folder_(folder), store_(store), listener_(listener), thread_([this] { Run(); }) {}

Committer::~Committer() { Stop(); }

void Committer::RestoreLog(const job::JobId& job, int32_t frame, uint64_t committed_bytes) {
  absl::MutexLock lock(&mutex_);
  committed_bytes_[{job, frame}] = committed_bytes;
}

void Committer::Enqueue(AcceptedUnit unit) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) queue_.emplace_back(std::move(unit));
}

void Committer::Discard(const job::JobId& job, std::optional<int32_t> frame) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) queue_.emplace_back(DiscardOrder{job, frame});
}

void Committer::Check(const job::JobId& job, int32_t frame, const absl::Status& cause) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) queue_.emplace_back(CheckOrder{job, frame, cause});
}

void Committer::Stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  if (thread_.joinable()) thread_.join();
}

std::deque<Committer::Task> Committer::TakeTasks() {
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(this, &Committer::HasWork));
  std::deque<Task> tasks;
  while (!queue_.empty() && tasks.size() < kMaxBatch) {
    tasks.push_back(std::move(queue_.front()));
    queue_.pop_front();
  }
  return tasks;
}

void Committer::Run() {
  while (true) {
    std::deque<Task> tasks = TakeTasks();
    if (tasks.empty()) return;  // stopping, and the queue is empty
    // By job, so that a damaged log fails its own job only.
    std::map<job::JobId, std::vector<AcceptedUnit>> units;
    for (Task& task : tasks) {
      if (auto* unit = std::get_if<AcceptedUnit>(&task)) {
        units[unit->stored.unit.job].push_back(std::move(*unit));
        continue;
      }
      if (const auto* discard = std::get_if<DiscardOrder>(&task)) {
        Commit(std::exchange(units[discard->job], {}));
        Execute(*discard);
      }
      if (const auto* check = std::get_if<CheckOrder>(&task)) {
        Commit(std::exchange(units[check->job], {}));
        Execute(*check);
      }
    }
    for (auto& [job, of_job] : units) Commit(std::move(of_job));
  }
}

void Committer::Commit(std::vector<AcceptedUnit> units) {
  if (units.empty() || !listener_->IsWanted(units.front().stored.unit.job)) return;
  const absl::Status status = Store(units);
  listener_->OnCommitted(units, status);
}

absl::Status Committer::Store(const std::vector<AcceptedUnit>& units) {
  std::vector<ledger::UnitRecord> records;
  std::set<film::UnitLog*> written;
  for (const AcceptedUnit& unit : units) {
    const absl::StatusOr<film::UnitLog*> log = LogOf({unit.stored.unit.job, unit.stored.unit.key.frame});
    if (!log.ok()) return log.status();
    const absl::StatusOr<film::RecordPlace> place = (*log)->Append(unit.stored);
    if (!place.ok()) return place.status();
    records.push_back(RecordOf(unit, *place));
    written.insert(*log);
  }
  for (film::UnitLog* log : written) {
    if (absl::Status status = log->Sync(); !status.ok()) return status;
  }
  return store_->CommitUnits(records, {UpdateOf(units)});
}

absl::StatusOr<film::UnitLog*> Committer::LogOf(const FrameKey& key) {
  const auto found = logs_.find(key);
  if (found != logs_.end()) return &found->second;
  if (absl::Status status = MakeFolder(folder_.FilmPath(key.first)); !status.ok()) return status;
  absl::StatusOr<film::UnitLog> log = OpenLog(key);
  if (absl::IsDataLoss(log.status())) {  // shorter than the ledger says
    const absl::StatusOr<std::vector<ledger::UnitRecord>> lost = TakeBackLostUnits(key);
    if (!lost.ok()) return lost.status();
    listener_->OnUnitsLost(key.first, key.second, log.status(), lost);
    log = OpenLog(key);
  }
  if (!log.ok()) return log.status();
  return &logs_.emplace(key, *std::move(log)).first->second;
}

absl::StatusOr<film::UnitLog> Committer::OpenLog(const FrameKey& key) {
  uint64_t committed_bytes = 0;
  {
    absl::MutexLock lock(&mutex_);
    const auto restored = committed_bytes_.find(key);
    if (restored != committed_bytes_.end()) committed_bytes = restored->second;
  }
  return film::UnitLog::Open(folder_.PathOf(DataFolder::UnitLogName(key.first, key.second)), committed_bytes);
}

absl::StatusOr<std::vector<ledger::UnitRecord>> Committer::TakeBackLostUnits(const FrameKey& key) {
  logs_.erase(key);  // its file may have been deleted: the next unit opens or creates it
  const absl::StatusOr<film::UnitLogReader> log =
      film::UnitLogReader::Open(folder_.PathOf(DataFolder::UnitLogName(key.first, key.second)));
  if (!log.ok() && !absl::IsNotFound(log.status())) return log.status();
  // The ledger is free for others while the log is read.
  std::vector<ledger::UnitRecord> units;
  const absl::Status listed = store_->ForEachUnit(
      key.first, key.second, [&units](const ledger::UnitRecord& record) { units.push_back(record); });
  if (!listed.ok()) return listed;
  std::vector<ledger::UnitRecord> lost;
  uint64_t committed_bytes = 0;
  for (ledger::UnitRecord& record : units) {
    if (log.ok() && CanBeRead(*log, record)) {
      committed_bytes = std::max(committed_bytes, record.offset + record.length);
    } else {
      lost.push_back(std::move(record));
    }
  }
  if (absl::Status status = store_->RevokeUnits(key.first, lost); !status.ok()) return status;
  absl::MutexLock lock(&mutex_);
  committed_bytes_[key] = committed_bytes;
  return lost;
}

void Committer::Execute(const CheckOrder& order) {
  if (!listener_->IsWanted(order.job)) return;
  listener_->OnUnitsLost(order.job, order.frame, order.cause, TakeBackLostUnits({order.job, order.frame}));
}

void Committer::Execute(const DiscardOrder& order) {
  std::erase_if(logs_, [&](const auto& entry) {
    return entry.first.first == order.job && (!order.frame.has_value() || entry.first.second == *order.frame);
  });
  const std::string path = order.frame.has_value()
                               ? folder_.PathOf(DataFolder::UnitLogName(order.job, *order.frame))
                               : folder_.FilmPath(order.job);
  // A file that cannot be deleted only takes space; the result is already written.
  RemoveAll(path).IgnoreError();
}

}  // namespace lumifold::server
