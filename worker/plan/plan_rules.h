#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "worker/plan/plan.h"
#include "worker/plan/scene_facts.h"

namespace lumifold::plan {

/// What rules decide from.
struct RuleInput {
  const SceneFacts& facts;
  const Probe& probe;
  const PlanSettings& settings;
};

/// What a rule decided.
struct Verdict {
  int value = 1;
  Source source = Source::kScene;
  std::string reason;
  std::string saving;
};

/// What computes and applies one decision of decisions::kAll.
struct Rule {
  std::string_view name;
  /// `so_far` holds the decisions of the rules before it.
  Verdict (*decide)(const RuleInput& input, const Plan& so_far);
  void (*apply)(int value, Plan* plan);
};

/// Of all decisions, in the order of decisions::kAll.
std::span<const Rule> Rules();

/// The tiles of the frame by their cost; empty for a full plan, and where the probe does not tell so many
/// apart.
std::vector<int> CostliestFirst(const RuleInput& input, const Plan& plan);

}  // namespace lumifold::plan
