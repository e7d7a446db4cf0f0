#pragma once

#include <memory>

namespace prometheus {
class Collectable;
}  // namespace prometheus

namespace lumifold::monitoring {

/// What Prometheus' client libraries show of a process, under their names: processor time and resident
/// memory.
std::shared_ptr<prometheus::Collectable> MakeProcessMetrics();

}  // namespace lumifold::monitoring
