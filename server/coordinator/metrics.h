#pragma once

#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"
#include "server/metrics/farm_metrics.h"

namespace lumifold::server {

/// What the metrics endpoint shows. Linear in active jobs and workers.
monitoring::FarmMetrics MetricsOf(const Resources& resources, FarmState* state);

}  // namespace lumifold::server
