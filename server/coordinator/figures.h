#pragma once

#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"
#include "server/metrics/farm_figures.h"

namespace lumifold::server {

/// What the metrics endpoint shows. Linear in active jobs and workers.
monitoring::FarmFigures FiguresOf(const Resources& resources, FarmState* state);

}  // namespace lumifold::server
