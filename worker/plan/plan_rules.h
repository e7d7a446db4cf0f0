#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

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

/// The description of one decision: all that computes, forces, applies and prints it.
struct Rule {
  std::string_view name;
  std::string_view governs;
  /// Values it may be forced to; 0 to 1 is a switch, "off" and "on".
  int least;
  int most;
  /// The value that models everything.
  int (*full)(const RuleInput& input);
  /// `so_far` holds the decisions of the rules before it.
  Verdict (*decide)(const RuleInput& input, const Plan& so_far);
  void (*apply)(const RuleInput& input, int value, Plan* plan);
  /// Neither the bits nor the channels of a unit depend on the decision, which needs no probe.
  bool exact = false;

  bool IsSwitch() const { return least == 0 && most == 1; }
};

/// All decisions in the order in which they are made.
std::span<const Rule> Rules();

}  // namespace lumifold::plan
