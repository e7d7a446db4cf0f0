#include "server/metrics/farm_figures.h"

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

MetricFamily WorkersOf(const FarmFigures& figures) {
  std::map<std::string, double> counts;
  for (const v1::WorkerState state :
       {v1::WORKER_STATE_IDLE, v1::WORKER_STATE_BUSY, v1::WORKER_STATE_DRAINING, v1::WORKER_STATE_SILENT,
        v1::WORKER_STATE_SET_ASIDE, v1::WORKER_STATE_BLOCKED})
    counts[LabelOf(v1::WorkerState_Name(state), "WORKER_STATE_")] = CountOf(figures.workers, state);
  return GaugeBy("state", "lumifold_workers", "Workers that are connected.", counts);
}

MetricFamily JobsOf(const FarmFigures& figures) {
  std::map<std::string, double> counts;
  for (const v1::JobState state : {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_PLANNED, v1::JOB_STATE_RUNNING,
                                   v1::JOB_STATE_FILTERING, v1::JOB_STATE_PAUSED})
    counts[LabelOf(v1::JobState_Name(state), "JOB_STATE_")] = CountOf(figures.jobs, state);
  return GaugeBy("state", "lumifold_jobs", "Jobs that have not ended.", counts);
}

MetricFamily RetriesOf(const FarmFigures& figures) {
  return CounterBy("reason", "lumifold_unit_retries_total",
                   "Leases that ended, or ran too long, so that their unit became free again.",
                   {figures.retries.begin(), figures.retries.end()});
}

std::vector<MetricFamily> FamiliesOf(const FarmFigures& figures) {
  const auto number = [](auto value) { return static_cast<double>(value); };
  return {
      Gauge("lumifold_units_queued",
            "Units of jobs that are not paused which no worker has and none has delivered.",
            number(figures.units_queued)),
      Gauge("lumifold_units_leased", "Units that workers have.", number(figures.units_leased)),
      Counter("lumifold_units_committed_total", "Units committed since this coordinator started.",
              number(figures.units_committed)),
      Gauge("lumifold_worker_slots", "Units that the connected workers take at a time.",
            number(figures.worker_slots)),
      Gauge("lumifold_page_viewers", "Browsers that watch the status page.", number(figures.page_viewers)),
      WorkersOf(figures),
      JobsOf(figures),
      Gauge("lumifold_blocked_workers", "Names of workers that are blocked, connected or not.",
            number(figures.blocked_names)),
      Counter("lumifold_samples_committed_total", "Camera samples of committed units.",
              number(figures.samples_committed)),
      Counter("lumifold_lease_expiries_total", "Leases that were not renewed, or made no progress.",
              number(figures.leases_expired)),
      RetriesOf(figures),
      CounterBy("kind", "lumifold_received_bytes_total",
                "Bytes of units from workers and of uploaded assets.",
                {{"assets", number(figures.traffic.assets_received)},
                 {"units", number(figures.traffic.units_received)}}),
      CounterBy("kind", "lumifold_sent_bytes_total", "Bytes of assets to workers and of results to clients.",
                {{"assets", number(figures.traffic.assets_sent)},
                 {"results", number(figures.traffic.results_sent)}}),
      Gauge("lumifold_storage_writable", "1 while the ledger and the data folder can be written, else 0.",
            figures.storage.writable ? 1 : 0),
      Gauge("lumifold_disk_free_bytes", "Free bytes of the data folder's disk.",
            number(figures.storage.free_bytes)),
      Gauge("lumifold_disk_room_bytes", "Free bytes that uploads and units may take.",
            number(figures.storage.room_bytes))};
}

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeFarmMetrics(std::function<FarmFigures()> figures) {
  return MakeSource([figures = std::move(figures)] { return FamiliesOf(figures()); });
}

}  // namespace lumifold::monitoring
