#include "proto/rpc/plan_text.h"

#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"

namespace lumifold::rpc {

std::string_view NameOf(v1::DecisionSource source) {
  switch (source) {
    case v1::DECISION_SOURCE_SCENE:
      return "scene";
    case v1::DECISION_SOURCE_PROBE:
      return "probe";
    case v1::DECISION_SOURCE_FULL:
      return "full";
    case v1::DECISION_SOURCE_FORCED:
      return "forced";
    default:
      return "";
  }
}

std::string ValueText(const v1::PlanDecision& decision) {
  const decisions::Decision* const known = decisions::Find(decision.name());
  return known != nullptr ? decisions::ValueText(*known, decision.value()) : absl::StrCat(decision.value());
}

std::string PlanLine(const v1::Plan& plan) {
  std::string line;
  for (const v1::PlanDecision& decision : plan.decisions()) {
    absl::StrAppend(&line, line.empty() ? "" : " ", decision.name(), "=", ValueText(decision), ":",
                    std::string(NameOf(decision.source())));
  }
  return line;
}

}  // namespace lumifold::rpc
