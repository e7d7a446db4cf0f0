#pragma once

#include <string>

namespace CLI {
class App;
}  // namespace CLI

namespace lumifold::monitoring {

/// Adds --metrics-address, which sets `address`, to a program that shows metrics. `address` must outlive
/// `app`.
void AddMetricsFlag(CLI::App* app, std::string* address);

}  // namespace lumifold::monitoring
