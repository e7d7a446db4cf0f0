#include "server/coordinator/takeover.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <set>
#include <utility>

#include "proto/logging/fields.h"
#include "server/assets/asset_store.h"
#include "server/storage/folder_contents.h"

namespace lumifold::server {

using job::JobId;
using job::WorkerId;

namespace {

/// Before a read of the storage that failed is repeated.
constexpr absl::Duration kAdoptionPause = absl::Milliseconds(250);
/// Connected workers that are looked at for one call of MoveWorkers.
constexpr int kMaxMovable = 1 << 16;

bool GetsLeases(v1::WorkerState state) {
  return state == v1::WORKER_STATE_IDLE || state == v1::WORKER_STATE_BUSY;
}

}  // namespace

void Takeover::SetMetrics(ledger::Member* member) {
  FarmState::View farm(state_);
  member->active_jobs = static_cast<int64_t>(farm->jobs.active().size());
  for (const auto& [id, worker] : farm->workers.connected()) {
    if (!GetsLeases(farm->scheduler.workers().Describe(id)->state)) continue;
    ++member->workers;
    member->slots += worker.slots;
  }
  for (const auto& [job, active] : farm->jobs.active()) member->demand += farm->LeasesWanted(job);
}

void Takeover::Adopt(const std::vector<ledger::AdoptedJob>& jobs) {
  resources_->log().info("event=jobs_adopted jobs={}", jobs.size());
  thread_.Run([this, jobs] {
    // Those that are waited for come first.
    for (const bool ended : {false, true}) {
      for (const ledger::AdoptedJob& job : jobs) {
        if (job.has_ended == ended) AdoptJob(job.id);
      }
    }
  });
}

void Takeover::AdoptJob(const JobId& job) {
  absl::Status status = TryToAdopt(job);
  while (IsStorageError(status)) {
    resources_->storage.Fail(status);
    if (stopping_.WaitFor(kAdoptionPause)) return;  // others adopt it
    status = TryToAdopt(job);
  }
  if (status.ok() || absl::IsNotFound(status)) return;
  resources_->log().error("event=job_not_adopted job={} error={}", job.value(),
                          logging::Quoted(status.message()));
}

absl::Status Takeover::TryToAdopt(const JobId& job) {
  // If its last owner goes on writing a result, it can no longer put it in the place of this coordinator's.
  if (absl::Status status = RemoveLeftoversOf(resources_->folder, job); !status.ok()) return status;
  const absl::StatusOr<std::optional<LoadedJob>> loaded = parts_.loader->Load(job);
  if (!loaded.ok()) return loaded.status();
  if (!loaded->has_value()) return absl::OkStatus();
  {
    FarmState::Change farm(state_);
    farm->submissions.Forget(job);
    if (farm->jobs.IsInMemory(job)) return absl::OkStatus();
    farm->EnterJob(**loaded);
    farm->frames.Wake();
  }
  parts_.loader->prerequisites().LookAgain((**loaded).after);
  return absl::OkStatus();
}

void Takeover::MoveWorkers(const cluster::WorkerMove& move) {
  FarmState::Change farm(state_);
  std::vector<scheduler::WorkerInfo> movable = farm->scheduler.workers().List(WorkerId(0), kMaxMovable);
  std::erase_if(movable, [](const scheduler::WorkerInfo& worker) { return !GetsLeases(worker.state); });
  std::stable_sort(movable.begin(), movable.end(),
                   [](const auto& a, const auto& b) { return a.leases < b.leases; });
  const auto count = static_cast<size_t>(std::max<int64_t>(move.workers, 0));
  movable.resize(std::min(movable.size(), count));
  for (const scheduler::WorkerInfo& worker : movable) farm->MoveWorker(worker.worker, move.address);
}

void Takeover::SendWorkersAway(const std::string& address) {
  FarmState::Change farm(state_);
  for (const auto& [worker, connected] : farm->workers.connected())
    farm->MoveWorker(worker, address, /*at_once=*/true);
}

void Takeover::OnExpelled() {
  parts_.stop_leasing();
  resources_->options.notify.on_expelled();
}

void Takeover::LookAtOthers() {
  if (is_looking_.exchange(true)) return;
  thread_.Run([this] {
    is_looking_ = false;
    parts_.submission->StartUncertainJobs();
    FindStoredAssets();
    parts_.loader->prerequisites().LookAtAll();
    parts_.operators->ReadBlockedWorkers().IgnoreError();  // it is read again
  });
}

void Takeover::FindStoredAssets() {
  const std::set<std::string> wanted = FarmState::View(state_)->jobs.WantedAssets();
  for (const std::string& sha256 : wanted) {
    if (resources_->assets->Has(sha256)) FarmState::Change(state_)->OnAssetFound(sha256);
  }
}

void Takeover::Stop() {
  stopping_.Notify();
  thread_.Stop();
}

}  // namespace lumifold::server
