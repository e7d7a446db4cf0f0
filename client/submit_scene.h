#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "client/assets.h"
#include "client/farm_client.h"
#include "client/progress.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Sends the coordinator the assets it lacks, each content once, and then the job; gives its id. `spec` is
/// the job without its scene. Errors: as FarmClient's.
absl::StatusOr<std::string> SubmitScene(FarmClient& farm, const SceneAssets& assets, v1::JobSpec spec,
                                        Progress& progress);

}  // namespace lumifold::client
