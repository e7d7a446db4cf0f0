#pragma once

#include <string>
#include <string_view>

#include "lumifold/v1/job.pb.h"

namespace lumifold::rpc {

/// "scene", "probe", "full" or "forced"; "" for a source that is not known.
std::string_view NameOf(v1::DecisionSource source);

/// "on", "off" or a number.
std::string ValueText(const v1::PlanDecision& decision);

/// "bounces=8:scene levels=0:scene ...": each decision and who made it, in one line.
std::string PlanLine(const v1::Plan& plan);

}  // namespace lumifold::rpc
