#include "server/coordinator/figures.h"

#include <array>
#include <utility>

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

monitoring::FarmFigures FiguresOf(const Resources& resources, FarmState* state) {
  monitoring::FarmFigures figures;
  const DiskSpace disk = DiskSpaceOf(resources.folder.root());
  figures.disk_free_bytes = disk.free_bytes;
  figures.disk_room_bytes = disk.room();
  figures.storage_writable = resources.storage.ok();
  figures.unit_bytes_received = resources.traffic.units_received;
  figures.asset_bytes_received = resources.traffic.assets_received;
  figures.result_bytes_sent = resources.traffic.results_sent;
  figures.asset_bytes_sent = resources.traffic.assets_sent;
  FarmState::View farm(state);
  const scheduler::Figures counts = farm->scheduler.CountAll();
  figures.units_queued = counts.units_queued;
  figures.units_leased = counts.units_leased;
  figures.units_committed = farm->totals.units_committed;
  figures.samples_committed = farm->totals.samples_committed;
  figures.leases_expired = counts.leases_expired;
  for (const auto& [reason, name] : kReasons) {
    const auto count = counts.retries.find(reason);
    figures.retries[name] = count == counts.retries.end() ? 0 : count->second;
  }
  figures.worker_slots = counts.slots;
  figures.workers = counts.workers;
  figures.blocked_names = static_cast<int64_t>(farm->scheduler.Blocked().size());
  for (const auto& [job, active] : farm->jobs.active())
    ++figures.jobs[StateOfActiveJob(active.record, farm->scheduler.Progress(job),
                                    farm->dependencies.IsWaiting(job))];
  return figures;
}

}  // namespace lumifold::server
