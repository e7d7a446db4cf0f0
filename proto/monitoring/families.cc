#include "proto/monitoring/families.h"

#include <prometheus/client_metric.h>
#include <prometheus/metric_type.h>

#include <utility>

namespace lumifold::monitoring {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

ClientMetric Sample(MetricType type, double value, std::vector<ClientMetric::Label> labels = {}) {
  ClientMetric sample;
  sample.label = std::move(labels);
  (type == MetricType::Counter ? sample.counter.value : sample.gauge.value) = value;
  return sample;
}

MetricFamily Labelled(MetricType type, const std::string& label, std::string name, std::string help,
                      const std::map<std::string, double>& values) {
  MetricFamily family{std::move(name), std::move(help), type, {}};
  for (const auto& [value, number] : values) family.metric.push_back(Sample(type, number, {{label, value}}));
  return family;
}

class Source final : public prometheus::Collectable {
 public:
  explicit Source(std::function<std::vector<MetricFamily>()> collect) : collect_(std::move(collect)) {}
  std::vector<MetricFamily> Collect() const override { return collect_(); }

 private:
  const std::function<std::vector<MetricFamily>()> collect_;
};

}  // namespace

MetricFamily Gauge(std::string name, std::string help, double value) {
  return {std::move(name), std::move(help), MetricType::Gauge, {Sample(MetricType::Gauge, value)}};
}

MetricFamily Counter(std::string name, std::string help, double value) {
  return {std::move(name), std::move(help), MetricType::Counter, {Sample(MetricType::Counter, value)}};
}

MetricFamily GaugeBy(const std::string& label, std::string name, std::string help,
                     const std::map<std::string, double>& values) {
  return Labelled(MetricType::Gauge, label, std::move(name), std::move(help), values);
}

MetricFamily CounterBy(const std::string& label, std::string name, std::string help,
                       const std::map<std::string, double>& values) {
  return Labelled(MetricType::Counter, label, std::move(name), std::move(help), values);
}

std::shared_ptr<prometheus::Collectable> MakeSource(std::function<std::vector<MetricFamily>()> collect) {
  return std::make_shared<Source>(std::move(collect));
}

}  // namespace lumifold::monitoring
