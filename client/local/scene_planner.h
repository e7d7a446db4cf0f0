#pragma once

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/local_work.h"

namespace lumifold::local {

/// Implements client::ScenePlanner as a worker does.
absl::StatusOr<v1::Plan> PlanScene(const v1::JobSpec& spec, const client::SceneAssets& assets);

/// Implements client::SceneCheck.
absl::Status CheckScene(const v1::JobSpec& spec, const client::SceneAssets& assets);

}  // namespace lumifold::local
