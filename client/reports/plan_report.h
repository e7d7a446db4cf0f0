#pragma once

#include <string>

#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// The plan for people: a line for each decision, then the probe's cost.
std::string PlanTable(const v1::Plan& plan);

/// The same on one line of JSON, complete, without the newline.
std::string PlanJson(const v1::Plan& plan);

}  // namespace lumifold::client
