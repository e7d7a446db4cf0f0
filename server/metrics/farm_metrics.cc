#include "server/metrics/farm_metrics.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "proto/monitoring/families.h"

namespace lumifold::monitoring {
namespace {

using prometheus::MetricFamily;

/// "WORKER_STATE_SET_ASIDE" becomes "set_aside".
std::string LabelOf(absl::string_view name, absl::string_view prefix) {
  return absl::AsciiStrToLower(absl::StripPrefix(name, prefix));
}

template <typename State>
double CountOf(const std::map<State, int64_t>& counts, State state) {
  const auto found = counts.find(state);
  return found == counts.end() ? 0 : static_cast<double>(found->second);
}

MetricFamily WorkersOf(const FarmMetrics& metrics) {
  std::map<std::string, double> counts;
  for (const v1::WorkerState state :
       {v1::WORKER_STATE_IDLE, v1::WORKER_STATE_BUSY, v1::WORKER_STATE_DRAINING, v1::WORKER_STATE_SILENT,
        v1::WORKER_STATE_RESTING, v1::WORKER_STATE_SET_ASIDE, v1::WORKER_STATE_BLOCKED})
    counts[LabelOf(v1::WorkerState_Name(state), "WORKER_STATE_")] = CountOf(metrics.workers, state);
  return GaugeBy("state", "lumifold_workers", "Workers that are connected.", counts);
}

MetricFamily JobsOf(const FarmMetrics& metrics) {
  std::map<std::string, double> counts;
  for (const v1::JobState state : {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_PLANNED, v1::JOB_STATE_RUNNING,
                                   v1::JOB_STATE_FILTERING, v1::JOB_STATE_PAUSED})
    counts[LabelOf(v1::JobState_Name(state), "JOB_STATE_")] = CountOf(metrics.jobs, state);
  return GaugeBy("state", "lumifold_jobs", "Jobs that have not ended.", counts);
}

MetricFamily RetriesOf(const FarmMetrics& metrics) {
  return CounterBy("reason", "lumifold_unit_retries_total",
                   "Leases that ended, or ran too long, so that their unit became free again.",
                   {metrics.retries.begin(), metrics.retries.end()});
}

std::vector<MetricFamily> FamiliesOf(const FarmMetrics& metrics) {
  const auto number = [](auto value) { return static_cast<double>(value); };
  return {
      Gauge("lumifold_units_queued",
            "Units of jobs that are not paused which no worker has and none has delivered.",
            number(metrics.units_queued)),
      Gauge("lumifold_units_leased", "Units that workers have.", number(metrics.units_leased)),
      Counter("lumifold_units_committed_total", "Units committed since this coordinator started.",
              number(metrics.units_committed)),
      Gauge("lumifold_worker_slots", "Units that the connected workers take at a time.",
            number(metrics.worker_slots)),
      Gauge("lumifold_page_viewers", "Browsers that watch the status page.", number(metrics.page_viewers)),
      WorkersOf(metrics),
      JobsOf(metrics),
      GaugeBy("state", "lumifold_frames", "Frames that are rendered, and rounds of frames.",
              {{"filtering", number(metrics.frames.filtering)},
               {"on_workers", number(metrics.frames.on_workers)},
               {"waiting", number(metrics.frames.waiting)}}),
      Gauge("lumifold_blocked_workers", "Names of workers that are blocked, connected or not.",
            number(metrics.blocked_names)),
      Counter("lumifold_samples_committed_total", "Camera samples of committed units.",
              number(metrics.samples_committed)),
      Counter("lumifold_lease_expiries_total", "Leases that were not renewed, or made no progress.",
              number(metrics.leases_expired)),
      RetriesOf(metrics),
      CounterBy("kind", "lumifold_received_bytes_total",
                "Bytes of units and results from workers and of uploaded assets.",
                {{"assets", number(metrics.traffic.assets_received)},
                 {"results", number(metrics.traffic.results_received)},
                 {"units", number(metrics.traffic.units_received)}}),
      CounterBy("kind", "lumifold_sent_bytes_total",
                "Bytes of assets and units to workers and of results to clients.",
                {{"assets", number(metrics.traffic.assets_sent)},
                 {"results", number(metrics.traffic.results_sent)},
                 {"units", number(metrics.traffic.units_sent)}}),
      Gauge("lumifold_webhooks_waiting", "Calls of webhooks that no receiver has accepted yet.",
            number(metrics.webhooks.waiting())),
      CounterBy("outcome", "lumifold_webhook_calls_total",
                "Calls of webhooks: accepted, tries that failed, and those that were given up.",
                {{"delivered", number(metrics.webhooks.delivered())},
                 {"failed", number(metrics.webhooks.failed())},
                 {"given_up", number(metrics.webhooks.given_up())}}),
      Gauge("lumifold_storage_writable", "1 while the ledger and the data folder can be written, else 0.",
            metrics.storage.writable ? 1 : 0),
      Gauge("lumifold_disk_free_bytes", "Free bytes of the data folder's disk.",
            number(metrics.storage.free_bytes)),
      Gauge("lumifold_disk_room_bytes", "Free bytes that uploads and units may take.",
            number(metrics.storage.room_bytes))};
}

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeFarmMetrics(std::function<FarmMetrics()> metrics) {
  return MakeSource([metrics = std::move(metrics)] { return FamiliesOf(metrics()); });
}

}  // namespace lumifold::monitoring
