#include "server/metrics/farm_figures.h"

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"

namespace lumifold::monitoring {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

constexpr char kState[] = "state";

template <typename Number>
ClientMetric Sample(MetricType type, Number value, std::vector<ClientMetric::Label> labels = {}) {
  ClientMetric sample;
  sample.label = std::move(labels);
  (type == MetricType::Counter ? sample.counter.value : sample.gauge.value) = static_cast<double>(value);
  return sample;
}

template <typename Number>
MetricFamily Single(std::string name, std::string help, MetricType type, Number value) {
  return {std::move(name), std::move(help), type, {Sample(type, value)}};
}

/// "WORKER_STATE_SET_ASIDE" becomes "set_aside".
std::string LabelOf(absl::string_view name, absl::string_view prefix) {
  return absl::AsciiStrToLower(absl::StripPrefix(name, prefix));
}

template <typename State>
ClientMetric CountOf(const std::map<State, int64_t>& counts, State state, absl::string_view name,
                     absl::string_view prefix) {
  const auto found = counts.find(state);
  return Sample(MetricType::Gauge, found == counts.end() ? 0 : found->second,
                {{kState, LabelOf(name, prefix)}});
}

MetricFamily WorkersOf(const FarmFigures& figures) {
  MetricFamily workers{"lumifold_workers", "Workers that are connected.", MetricType::Gauge, {}};
  for (const v1::WorkerState state :
       {v1::WORKER_STATE_IDLE, v1::WORKER_STATE_BUSY, v1::WORKER_STATE_DRAINING, v1::WORKER_STATE_SILENT,
        v1::WORKER_STATE_SET_ASIDE, v1::WORKER_STATE_BLOCKED})
    workers.metric.push_back(CountOf(figures.workers, state, v1::WorkerState_Name(state), "WORKER_STATE_"));
  return workers;
}

MetricFamily JobsOf(const FarmFigures& figures) {
  MetricFamily jobs{"lumifold_jobs", "Jobs that have not ended.", MetricType::Gauge, {}};
  for (const v1::JobState state : {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_PLANNED, v1::JOB_STATE_RUNNING,
                                   v1::JOB_STATE_FILTERING, v1::JOB_STATE_PAUSED})
    jobs.metric.push_back(CountOf(figures.jobs, state, v1::JobState_Name(state), "JOB_STATE_"));
  return jobs;
}

MetricFamily RetriesOf(const FarmFigures& figures) {
  MetricFamily retries{"lumifold_unit_retries_total",
                       "Leases that ended, or ran too long, so that their unit became free again.",
                       MetricType::Counter,
                       {}};
  for (const auto& [reason, count] : figures.retries)
    retries.metric.push_back(Sample(MetricType::Counter, count, {{"reason", reason}}));
  return retries;
}

MetricFamily BytesOf(std::string name, std::string help, const std::map<std::string, int64_t>& bytes) {
  MetricFamily family{std::move(name), std::move(help), MetricType::Counter, {}};
  for (const auto& [kind, count] : bytes)
    family.metric.push_back(Sample(MetricType::Counter, count, {{"kind", kind}}));
  return family;
}

class FarmMetrics final : public prometheus::Collectable {
 public:
  explicit FarmMetrics(std::function<FarmFigures()> figures) : figures_(std::move(figures)) {}

  std::vector<MetricFamily> Collect() const override {
    const FarmFigures figures = figures_();
    return {
        Single("lumifold_units_queued",
               "Units of jobs that are not paused which no worker has and none has delivered.",
               MetricType::Gauge, figures.units_queued),
        Single("lumifold_units_leased", "Units that workers have.", MetricType::Gauge, figures.units_leased),
        Single("lumifold_units_committed_total", "Units committed since this coordinator started.",
               MetricType::Counter, figures.units_committed),
        Single("lumifold_worker_slots", "Units that the connected workers take at a time.", MetricType::Gauge,
               figures.worker_slots),
        WorkersOf(figures),
        JobsOf(figures),
        Single("lumifold_blocked_workers", "Names of workers that are blocked, connected or not.",
               MetricType::Gauge, figures.blocked_names),
        Single("lumifold_samples_committed_total", "Camera samples of committed units.", MetricType::Counter,
               figures.samples_committed),
        Single("lumifold_lease_expiries_total", "Leases that were not renewed, or made no progress.",
               MetricType::Counter, figures.leases_expired),
        RetriesOf(figures),
        BytesOf("lumifold_received_bytes_total", "Bytes of units from workers and of uploaded assets.",
                {{"assets", figures.asset_bytes_received}, {"units", figures.unit_bytes_received}}),
        BytesOf("lumifold_sent_bytes_total", "Bytes of assets to workers and of results to clients.",
                {{"assets", figures.asset_bytes_sent}, {"results", figures.result_bytes_sent}}),
        Single("lumifold_storage_writable", "1 while the ledger and the data folder can be written, else 0.",
               MetricType::Gauge, figures.storage_writable ? 1 : 0),
        Single("lumifold_disk_free_bytes", "Free bytes of the data folder's disk.", MetricType::Gauge,
               figures.disk_free_bytes),
        Single("lumifold_disk_room_bytes", "Free bytes that uploads and units may take.", MetricType::Gauge,
               figures.disk_room_bytes)};
  }

 private:
  const std::function<FarmFigures()> figures_;
};

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeFarmMetrics(std::function<FarmFigures()> figures) {
  return std::make_shared<FarmMetrics>(std::move(figures));
}

}  // namespace lumifold::monitoring
