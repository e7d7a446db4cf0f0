#include "server/commit/committer.h"

#include <memory>
#include <optional>
#include <utility>

namespace lumifold::server {
namespace {

/// Maximum number of units in a batch. Limits the memory of a batch and the delay of acknowledgements.
constexpr size_t kMaxBatch = 256;

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
      store_(store),
      storage_(storage),
      timings_(timings),
      listener_(listener),
      logs_({.epoch = options.epoch,
             .max_open = options.storage.max_open_logs,
             .on_lost =
                 [listener](const FrameKey& frame, const absl::Status& cause,
                            const FrameLogs::LostUnits& lost) {
                   listener->OnUnitsLost(frame.first, frame.second, cause, lost);
                 }},
            folder, store),
      reserve_(folder.ReservePath(), options.storage.reserve_bytes, folder.files()),
      pauses_(options.storage.pauses) {
  storage_->OnFail([this] { queue_.NoteStorageFailure(); });
}

Committer::~Committer() { Stop(); }

void Committer::RestoreLog(const FrameKey& frame, uint64_t committed_bytes) {
  logs_.Restore(frame, committed_bytes);
}

void Committer::Start() {
  thread_ = std::thread([this] { Run(); });
}

void Committer::Enqueue(AcceptedUnit unit) { queue_.Add(std::move(unit)); }

void Committer::Write(std::function<absl::Status()> write, std::function<void(const absl::Status&)> done) {
  queue_.Add(CommitQueue::Order{std::move(write), std::move(done)});
}

void Committer::Check(const FrameKey& frame, const absl::Status& cause) {
  using Lost = FrameLogs::LostUnits;
  const auto lost = std::make_shared<Lost>();
  Write(
      [this, frame, lost] {
        *lost = listener_->IsWanted(frame.first) ? logs_.TakeBackLost(frame) : Lost(absl::CancelledError(""));
        return lost->status();
      },
      [this, frame, cause, lost](const absl::Status&) {
        if (listener_->IsWanted(frame.first)) listener_->OnUnitsLost(frame.first, frame.second, cause, *lost);
      });
}

void Committer::Discard(const FrameKey& frame, const std::vector<job::UnitKey>& units) {
  using Lost = FrameLogs::LostUnits;
  const auto lost = std::make_shared<Lost>();
  Write(
      [this, frame, units, lost] {
        if (!listener_->IsWanted(frame.first)) return absl::CancelledError("");
        // First the records: a crash in between leaves rows without records, which are found and rendered
        // again.
        if (absl::Status status = logs_.Void(frame, units); !status.ok()) return status;
        *lost = logs_.TakeBackLost(frame);
        return lost->status();
      },
      [this, frame, units, lost](const absl::Status&) {
        if (listener_->IsWanted(frame.first)) listener_->OnUnitsDiscarded(frame, units, *lost);
      });
}

void Committer::ForgetLog(const FrameKey& frame) { logs_.Forget(frame); }

void Committer::ForgetLogs(const job::JobId& job) { logs_.ForgetLogs(job); }

void Committer::ForgetJob(const job::JobId& job) {
  logs_.ForgetJob(job);
  batch_.erase(job);
  queue_.DropUnits(job);
}

void Committer::Stop() {
  queue_.Stop();
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
    pauses_.Reset();
    if (storage_->ok()) continue;
    storage_->Recover();
    listener_->OnStorageAvailable();
  }
}

bool Committer::AwaitWork() {
  if (!batch_.empty()) return true;  // it is tried again
  const CommitQueue::Work work = queue_.Await();
  if (work == CommitQueue::Work::kStorageFailed && pauses_.failures() == 0) {
    reserve_.GiveUp();
    Pause();
  }
  return work != CommitQueue::Work::kEnded;
}

bool Committer::Pause() {
  queue_.Pause(options_.now() + pauses_.Next(), options_.now);
  return !queue_.is_stopping();
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
  while (const std::optional<CommitQueue::Order> order = queue_.FirstOrder()) {
    const absl::Status status = order->write();
    if (IsStorageError(status)) return status;
    queue_.PopOrder();
    order->done(status);
  }
  return absl::OkStatus();
}

absl::Status Committer::CommitBatch() {
  if (batch_.empty()) {
    for (AcceptedUnit& unit : queue_.TakeUnits(kMaxBatch))
      batch_[unit.stored.unit.job].units.push_back(std::move(unit));
    batch_is_synced_ = false;
  }
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
      logs_.OnCommitted(job, record);
    }
    // What was written for the job is no longer wanted.
    if (!status.ok()) logs_.ForgetLogs(job);
    listener_->OnCommitted(of_job.units, status);
  }
}

absl::Status Committer::WriteLogs() {
  for (auto& [job, batch] : batch_) {
    batch.commit = CommitOf(batch.units, options_.epoch);
    absl::StatusOr<std::vector<ledger::UnitRecord>> records = logs_.Write(job, &batch.units);
    if (IsStorageError(records.status())) return records.status();
    batch.error = records.status();
    if (records.ok()) batch.commit.units = *std::move(records);
  }
  return absl::OkStatus();
}

}  // namespace lumifold::server
