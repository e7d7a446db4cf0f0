// What the metrics endpoint shows.
#include <array>
#include <utility>

#include "server/coordinator/coordinator.h"
#include "server/coordinator/job_status.h"
#include "server/storage/disk_space.h"

namespace lumifold::server {
namespace {

using scheduler::RetryReason;

constexpr std::array<std::pair<RetryReason, const char*>, 10> kReasons = {{
    {RetryReason::kWorkerLost, "worker_lost"},
    {RetryReason::kWorkerBlocked, "worker_blocked"},
    {RetryReason::kExpired, "expired"},
    {RetryReason::kStalled, "stalled"},
    {RetryReason::kDropped, "dropped"},
    {RetryReason::kOverdue, "overdue"},
    {RetryReason::kHandedBack, "handed_back"},
    {RetryReason::kFailed, "failed"},
    {RetryReason::kOtherClass, "other_class"},
    {RetryReason::kTakenBack, "taken_back"},
}};

}  // namespace

monitoring::FarmFigures Coordinator::Figures() {
  monitoring::FarmFigures figures;
  const DiskSpace disk = DiskSpaceOf(folder_.root());
  figures.disk_free_bytes = disk.free_bytes;
  figures.disk_room_bytes = disk.room();
  figures.storage_writable = storage_.ok();
  figures.unit_bytes_received = traffic_.units_received;
  figures.asset_bytes_received = traffic_.assets_received;
  figures.result_bytes_sent = traffic_.results_sent;
  figures.asset_bytes_sent = traffic_.assets_sent;
  absl::MutexLock lock(&mutex_);
  const scheduler::Figures counts = scheduler_.CountAll();
  figures.units_queued = counts.units_queued;
  figures.units_leased = counts.units_leased;
  figures.units_committed = units_committed_;
  figures.samples_committed = samples_committed_;
  figures.leases_expired = counts.leases_expired;
  for (const auto& [reason, name] : kReasons) {
    const auto count = counts.retries.find(reason);
    figures.retries[name] = count == counts.retries.end() ? 0 : count->second;
  }
  figures.worker_slots = counts.slots;
  figures.workers = counts.workers;
  figures.blocked_names = static_cast<int64_t>(scheduler_.Blocked().size());
  for (const auto& [job, record] : active_jobs_)
    ++figures.jobs[StateOfActiveJob(record, scheduler_.Progress(job))];
  return figures;
}

}  // namespace lumifold::server
