#pragma once

#include "absl/status/statusor.h"
#include "client/scene_planner.h"

namespace lumifold::local {

/// Implements client::ScenePlanner with the worker's loader and the plan library.
absl::StatusOr<client::PlanTexts> PlanScene(const v1::JobSpec& spec, const client::SceneAssets& assets,
                                            const client::PlanOptions& options);

}  // namespace lumifold::local
