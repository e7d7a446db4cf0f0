#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "client/assets.h"
#include "client/farm_client.h"
#include "client/progress.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Uploads the assets that the coordinator does not have, each content once, submits the job and returns its
/// id. `spec` is the job without its scene.
/// Errors: those of FarmClient.
absl::StatusOr<std::string> SubmitScene(FarmClient& farm, const SceneAssets& assets, v1::JobSpec spec,
                                        Progress& progress);

}  // namespace lumifold::client
