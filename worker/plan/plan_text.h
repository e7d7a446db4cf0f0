#pragma once

#include <string>

#include "worker/plan/plan.h"

namespace lumifold::plan {

/// The plan for people: a line for each decision, then the probe's cost.
std::string PlanTable(const Plan& plan);

/// The same on one line of JSON, complete.
std::string PlanJson(const Plan& plan);

}  // namespace lumifold::plan
