#pragma once

#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace lumifold::monitoring {

/// A metric with one sample and no label.
prometheus::MetricFamily Gauge(std::string name, std::string help, double value);
prometheus::MetricFamily Counter(std::string name, std::string help, double value);

/// A metric with a sample for each value of a label.
prometheus::MetricFamily GaugeBy(const std::string& label, std::string name, std::string help,
                                 const std::map<std::string, double>& values);
prometheus::MetricFamily CounterBy(const std::string& label, std::string name, std::string help,
                                   const std::map<std::string, double>& values);

/// A source for the endpoint that calls `collect`, from the endpoint's thread, whenever it is asked.
std::shared_ptr<prometheus::Collectable> MakeSource(
    std::function<std::vector<prometheus::MetricFamily>()> collect);

}  // namespace lumifold::monitoring
