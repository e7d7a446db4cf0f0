#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "client/assets.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Plans a job by its first frame: `spec` names the scene, `assets` are its files. The program passes this
/// function in, so that the client library does not link the renderer.
/// Errors: those of worker::LoadJobScene and worker::PlanJob.
using ScenePlanner =
    std::function<absl::StatusOr<v1::Plan>(const v1::JobSpec& spec, const SceneAssets& assets)>;

}  // namespace lumifold::client
