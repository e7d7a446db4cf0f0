#pragma once

#include <string>

#include "lumifold/v1/farm.pb.h"

namespace lumifold::client {

/// Core hours by user, and by job, as tables.
std::string UsageText(const v1::GetUsageResponse& usage);

/// A JSON object for each job, in lines. docs/cli.md documents its fields.
std::string UsageJson(const v1::GetUsageResponse& usage);

}  // namespace lumifold::client
