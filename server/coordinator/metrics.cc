#include "server/coordinator/metrics.h"

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

monitoring::FarmMetrics MetricsOf(const Resources& resources, FarmState* state) {
  monitoring::FarmMetrics metrics;
  const DiskSpace disk = DiskSpaceOf(resources.folder.root());
  metrics.storage.free_bytes = disk.free_bytes;
  metrics.storage.room_bytes = disk.room();
  metrics.storage.writable = resources.storage.ok();
  metrics.traffic.units_received = resources.traffic.units_received;
  metrics.traffic.assets_received = resources.traffic.assets_received;
  metrics.traffic.results_sent = resources.traffic.results_sent;
  metrics.traffic.assets_sent = resources.traffic.assets_sent;
  metrics.traffic.units_sent = resources.traffic.units_sent;
  metrics.traffic.results_received = resources.traffic.results_received;
  metrics.webhooks = resources.webhooks->counts().value_or(v1::WebhookCounts());
  FarmState::View farm(state);
  const scheduler::Metrics counts = farm->scheduler.CountAll();
  metrics.units_queued = counts.units_queued;
  metrics.units_leased = counts.units_leased;
  metrics.units_committed = farm->totals.units_committed;
  metrics.samples_committed = farm->totals.samples_committed;
  metrics.leases_expired = counts.leases_expired;
  for (const auto& [reason, name] : kReasons) {
    const auto count = counts.retries.find(reason);
    metrics.retries[name] = count == counts.retries.end() ? 0 : count->second;
  }
  metrics.worker_slots = counts.slots;
  metrics.workers = counts.workers;
  metrics.blocked_names = static_cast<int64_t>(farm->scheduler.workers().Blocked().size());
  metrics.frames.on_workers = farm->finish_leases.size();
  metrics.frames.filtering = static_cast<int64_t>(farm->frames.running().size()) - metrics.frames.on_workers;
  metrics.frames.waiting = static_cast<int64_t>(farm->frames.waiting().size());
  for (const auto& [job, active] : farm->jobs.active())
    ++metrics.jobs[StateOfActiveJob(active.record, farm->scheduler.jobs().Progress(job),
                                    farm->dependencies.IsWaiting(job))];
  return metrics;
}

}  // namespace lumifold::server
