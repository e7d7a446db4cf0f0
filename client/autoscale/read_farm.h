#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/autoscale/policy/types.h"
#include "client/farm/farm_client.h"

namespace lumifold::autoscale {

/// What workers with these tags could render, and the workers that are there. Needs scope read.
/// Errors: those of the calls; kUnavailable while the coordinator grants no leases, because it cannot write.
absl::StatusOr<FarmState> ReadFarm(client::FarmClient& farm, const std::vector<std::string>& tags);

}  // namespace lumifold::autoscale
