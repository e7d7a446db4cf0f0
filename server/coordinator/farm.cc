// What a coordinator does as one of several over the same ledger and data folder; see cluster::Membership.
#include <spdlog/logger.h>

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"
#include "server/job/job_state.h"

namespace lumifold::server {

using job::JobId;

namespace {

/// Before a read of the storage that failed is repeated.
constexpr absl::Duration kAdoptionPause = absl::Milliseconds(250);

}  // namespace

void Coordinator::SetAddress(const std::string& address) {
  absl::MutexLock lock(&mutex_);
  address_ = address;
}

void Coordinator::SetFigures(ledger::Member* member) {
  absl::MutexLock lock(&mutex_);
  member->active_jobs = static_cast<int64_t>(active_jobs_.size());
  for (const auto& [id, worker] : workers_) {
    const v1::WorkerState state = scheduler_.DescribeWorker(id)->state;
    if (state != v1::WORKER_STATE_IDLE && state != v1::WORKER_STATE_BUSY)
      continue;  // it leaves, or gets no leases
    ++member->workers;
    member->slots += worker.slots;
  }
  for (const auto& [job, record] : active_jobs_) member->demand += LeasesWanted(job, record);
}

int64_t Coordinator::LeasesWanted(const JobId& job, const ledger::JobRecord& record) {
  const bool may_run = scheduler_.HasJob(job) && !record.scheduling.paused() &&
                       !dependencies_.IsWaiting(job) && !wanted_assets_.contains(job);
  if (!may_run) return 0;
  const scheduler::JobProgress progress = scheduler_.Progress(job);
  const int64_t left = progress.units_total - progress.units_done;
  const int64_t limit = record.scheduling.max_leases();
  return limit > 0 ? std::min(left, limit) : left;
}

void Coordinator::Adopt(const std::vector<ledger::AdoptedJob>& jobs) {
  options_.log->info("event=jobs_adopted jobs={}", jobs.size());
  farm_thread_.Run([this, jobs] {
    // Those that are waited for come first.
    for (const bool ended : {false, true}) {
      for (const ledger::AdoptedJob& job : jobs) {
        if (job.has_ended == ended) AdoptJob(job.id);
      }
    }
  });
}

void Coordinator::AdoptJob(const JobId& job) {
  absl::Status status = TryToAdopt(job);
  while (IsStorageError(status)) {
    storage_.Fail(status);
    adopting_.Consume(kAdoptionPause);
    {
      absl::MutexLock lock(&mutex_);
      if (stopping_) return;  // others adopt it
    }
    status = TryToAdopt(job);
  }
  if (status.ok() || absl::IsNotFound(status)) return;
  options_.log->error("event=job_not_adopted job={} error={}", job.value(),
                      logging::Quoted(std::string(status.message())));
}

absl::Status Coordinator::TryToAdopt(const JobId& job) {
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  if (job::HasEnded(record->state)) {
    janitor_.JobEnded(job, record->state, record->error);
    return absl::OkStatus();
  }
  // If its last owner goes on writing a result, it can no longer put it in the place of this coordinator's.
  if (absl::Status status = folder_.RemoveLeftoversOf(job); !status.ok()) return status;
  absl::StatusOr<LoadedJob> loaded = LoadJob(*record);
  if (!loaded.ok()) return loaded.status();
  const std::vector<job::Prerequisite> after = loaded->after;
  {
    absl::MutexLock lock(&mutex_);
    uncertain_jobs_.erase(job);
    if (IsInMemory(job)) return absl::OkStatus();
    EnterJob(*loaded);
    changed_jobs_.insert(job);
    housekeeping_.Notify();
    finishing_.Notify();
    GrantLeases();
  }
  CheckPrerequisites(after);
  return absl::OkStatus();
}

void Coordinator::MoveWorkers(const cluster::WorkerMove& move) {
  MoveWorkers(static_cast<int>(std::min<int64_t>(move.workers, std::numeric_limits<int>::max())),
              move.address);
}

void Coordinator::OnExpelled() {
  StopLeasing();
  options_.on_expelled();
}

void Coordinator::LookAtOthers(const std::vector<ledger::Member>& members) {
  if (looking_.exchange(true)) return;
  farm_thread_.Run([this, members] {
    looking_ = false;
    StartUncertainJobs();
    FindStoredAssets();
    LookAtPrerequisites();
    FollowBlockedWorkers();
    RouteInHand(members);
  });
}

void Coordinator::StartUncertainJobs() {
  std::set<JobId> jobs;
  {
    absl::MutexLock lock(&mutex_);
    jobs = uncertain_jobs_;
  }
  for (const JobId& job : jobs) {
    const absl::StatusOr<JobId> started = StartIfUncertain(job);
    if (!absl::IsNotFound(started.status())) continue;
    // It was not recorded; the client submits it again, perhaps elsewhere.
    absl::MutexLock lock(&mutex_);
    uncertain_jobs_.erase(job);
  }
}

void Coordinator::FindStoredAssets() {
  std::set<std::string> wanted;
  {
    absl::MutexLock lock(&mutex_);
    for (const auto& [job, asset] : wanted_assets_) wanted.insert(asset.sha256());
  }
  for (const std::string& sha256 : wanted) {
    if (assets_->Has(sha256)) OnAssetStored(sha256);
  }
}

void Coordinator::LookAtPrerequisites() {
  std::vector<job::Prerequisite> after;
  {
    absl::MutexLock lock(&mutex_);
    for (const JobId& job : dependencies_.Named()) {
      if (!IsInMemory(job)) after.push_back({job, v1::JOB_STATE_RUNNING});
    }
  }
  CheckPrerequisites(after);
}

void Coordinator::RouteInHand(const std::vector<ledger::Member>& members) {
  std::vector<JobId> jobs;
  {
    absl::MutexLock lock(&mutex_);
    for (const auto& [job, units] : in_hand_) jobs.push_back(job);
  }
  for (const JobId& job : jobs) {
    const absl::StatusOr<ledger::Epoch> owner = OwnerOf(job);
    if (!owner.ok() || *owner == owner_.epoch) continue;
    for (const ledger::Member& member : members) {
      if (member.owner.epoch == *owner) MoveWorkersWith(job, member.address);
    }
  }
}

void Coordinator::FollowBlockedWorkers() {
  absl::MutexLock control(&control_mutex_);
  const absl::StatusOr<std::vector<ledger::BlockedWorker>> recorded = store_->BlockedWorkers();
  if (!recorded.ok()) return;
  absl::MutexLock lock(&mutex_);
  std::set<std::string> lifted;
  for (const scheduler::BlockedWorker& worker : scheduler_.Blocked()) lifted.insert(worker.name);
  for (const ledger::BlockedWorker& worker : *recorded) {
    if (lifted.erase(worker.name) == 0) scheduler_.BlockWorker(worker.name, worker.reason);
  }
  for (const std::string& name : lifted) scheduler_.ReadmitWorker(name);
  SendVoided();
  GrantLeases();
}

absl::StatusOr<ledger::Epoch> Coordinator::OwnerOf(const JobId& job) {
  {
    absl::MutexLock lock(&mutex_);
    if (IsInMemory(job)) return owner_.epoch;
  }
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  return record->owner.epoch;
}

}  // namespace lumifold::server
