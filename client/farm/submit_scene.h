#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "client/cli/progress.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"
#include "client/scene/assets.h"
#include "lumifold/v1/farm.pb.h"

namespace lumifold::client {

/// Uploads the assets that the coordinator does not have, each content once, submits the job and returns its
/// id. `job` is the submission without scene and request id. A first call that fails is an error at once;
/// after it, a coordinator that goes away is tried again as long as `backoff` allows without progress.
/// Errors: those of FarmClient.
absl::StatusOr<std::string> SubmitScene(FarmClient& farm, const SceneAssets& assets, v1::SubmitJobRequest job,
                                        Progress& progress, const Backoff& backoff);

}  // namespace lumifold::client
