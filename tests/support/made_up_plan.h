#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "filter/image/decisions.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold {

/// What a worker might deliver for the plan unit of a job that asks for neither tile size nor pass samples
/// and forces nothing: all layers, no bounces, and these units. With an order of tiles costliest-first is on.
inline v1::Plan MadeUpPlan(int tile_size = 8, int pass_samples = 4,
                           const std::vector<int32_t>& tile_order = {}) {
  v1::Plan plan;
  for (const decisions::Decision& known : decisions::kAll) {
    v1::PlanDecision* decision = plan.add_decisions();
    decision->set_name(std::string(known.name));
    decision->set_value(known.full);
    if (known.name == decisions::kBounces) decision->set_value(0);
    if (known.name == decisions::kTileSize) decision->set_value(tile_size);
    if (known.name == decisions::kPassSamples) decision->set_value(pass_samples);
    if (known.name == decisions::kCostliestFirst) decision->set_value(tile_order.empty() ? 0 : 1);
    decision->set_source(v1::DECISION_SOURCE_PROBE);
    decision->set_reason("made up");
  }
  plan.set_probe_rays(1000);
  for (const int32_t tile : tile_order) plan.add_tile_order(tile);
  return plan;
}

}  // namespace lumifold
