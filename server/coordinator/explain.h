#pragma once

#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "server/coordinator/farm.h"

namespace lumifold::server {

/// Adds why a job in memory is not further, most important first.
void ExplainWaiting(const Farm& farm, const job::JobId& job, absl::Time now,
                    v1::ExplainJobResponse* response);
/// Adds one reason.
void AddReason(const std::string& code, const std::string& text, v1::ExplainJobResponse* response);

/// How a missing file of a scene is named.
std::string NameOfAsset(const v1::AssetRef& asset);

}  // namespace lumifold::server
