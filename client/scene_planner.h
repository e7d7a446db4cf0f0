#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/assets.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

struct PlanOptions {
  bool full = false;                // model everything
  std::vector<std::string> forced;  // "NAME=VALUE": decisions to override
};

/// What `plan` prints.
struct PlanTexts {
  std::string table;  // for people
  std::string json;   // one line
};

/// Plans the first frame of a job: `spec` names the scene, `assets` are its files. The program passes this
/// function in, so that the client library does not link the renderer.
/// Errors: those of worker::LoadJobScene, plan::RunProbe and plan::MakePlan.
using ScenePlanner = std::function<absl::StatusOr<PlanTexts>(
    const v1::JobSpec& spec, const SceneAssets& assets, const PlanOptions& options)>;

}  // namespace lumifold::client
