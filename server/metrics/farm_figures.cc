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

ClientMetric Sample(MetricType type, int64_t value, std::vector<ClientMetric::Label> labels = {}) {
  ClientMetric sample;
  sample.label = std::move(labels);
  (type == MetricType::Counter ? sample.counter.value : sample.gauge.value) = static_cast<double>(value);
  return sample;
}

MetricFamily Single(std::string name, std::string help, MetricType type, int64_t value) {
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

class FarmMetrics final : public prometheus::Collectable {
 public:
  explicit FarmMetrics(std::function<FarmFigures()> figures) : figures_(std::move(figures)) {}

  std::vector<MetricFamily> Collect() const override {
    const FarmFigures figures = figures_();
    MetricFamily workers{"lumifold_workers", "Workers that are connected.", MetricType::Gauge, {}};
    for (const v1::WorkerState state :
         {v1::WORKER_STATE_IDLE, v1::WORKER_STATE_BUSY, v1::WORKER_STATE_DRAINING, v1::WORKER_STATE_SILENT,
          v1::WORKER_STATE_SET_ASIDE, v1::WORKER_STATE_BLOCKED})
      workers.metric.push_back(CountOf(figures.workers, state, v1::WorkerState_Name(state), "WORKER_STATE_"));
    MetricFamily jobs{"lumifold_jobs", "Jobs that have not ended.", MetricType::Gauge, {}};
    for (const v1::JobState state : {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_PLANNED, v1::JOB_STATE_RUNNING,
                                     v1::JOB_STATE_FILTERING, v1::JOB_STATE_PAUSED})
      jobs.metric.push_back(CountOf(figures.jobs, state, v1::JobState_Name(state), "JOB_STATE_"));
    return {
        Single("lumifold_units_queued",
               "Units of jobs that are not paused which no worker has and none has delivered.",
               MetricType::Gauge, figures.units_queued),
        Single("lumifold_units_leased", "Units that workers have.", MetricType::Gauge, figures.units_leased),
        Single("lumifold_units_committed_total", "Units committed since this coordinator started.",
               MetricType::Counter, figures.units_committed),
        Single("lumifold_worker_slots", "Units that the connected workers take at a time.", MetricType::Gauge,
               figures.worker_slots),
        std::move(workers),
        std::move(jobs)};
  }

 private:
  const std::function<FarmFigures()> figures_;
};

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeFarmMetrics(std::function<FarmFigures()> figures) {
  return std::make_shared<FarmMetrics>(std::move(figures));
}

}  // namespace lumifold::monitoring
