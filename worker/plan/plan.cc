#include "worker/plan/plan.h"

#include <algorithm>
#include <map>
#include <optional>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "worker/plan/plan_rules.h"

namespace lumifold::plan {
namespace {

std::string ValueText(const Rule& rule, int value) {
  if (rule.IsSwitch()) return value != 0 ? "on" : "off";
  return absl::StrCat(value);
}

std::optional<int> ParseValue(const Rule& rule, const std::string& text) {
  if (rule.IsSwitch()) {
    if (text == "on") return 1;
    if (text == "off") return 0;
    return std::nullopt;
  }
  int value = 0;
  if (!absl::SimpleAtoi(text, &value) || value < rule.least || value > rule.most) return std::nullopt;
  return value;
}

/// Forced values by name of decision.
absl::StatusOr<std::map<std::string_view, int>> ParseForced(const std::vector<std::string>& forced) {
  std::map<std::string_view, int> values;
  for (const std::string& text : forced) {
    const size_t equals = text.find('=');
    const std::string name = text.substr(0, equals);
    const auto rule =
        std::find_if(Rules().begin(), Rules().end(), [&](const Rule& r) { return r.name == name; });
    if (equals == std::string::npos || rule == Rules().end()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "'", text,
          "' is not NAME=VALUE with the name of a decision: ", absl::StrJoin(DecisionNames(), ", ")));
    }
    const std::optional<int> value = ParseValue(*rule, text.substr(equals + 1));
    if (!value.has_value()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "'", text, "': ", name, " is ",
          rule->IsSwitch() ? "on or off"
                           : absl::StrCat("a whole number from ", rule->least, " to ", rule->most)));
    }
    values[rule->name] = *value;
  }
  return values;
}

Verdict Decide(const Rule& rule, const RuleInput& input, const std::map<std::string_view, int>& forced,
               const Plan& so_far) {
  Verdict verdict = rule.decide(input, so_far);
  if (input.settings.full)
    verdict = {rule.full(input), Source::kFull, "everything is modelled", /*saving=*/""};
  const auto found = forced.find(rule.name);
  if (found == forced.end()) return verdict;
  return {found->second, Source::kForced,
          absl::StrCat("asked for; otherwise ", ValueText(rule, verdict.value), ": ", verdict.reason),
          /*saving=*/""};
}

}  // namespace

std::string_view NameOf(Source source) {
  switch (source) {
    case Source::kScene:
      return "scene";
    case Source::kProbe:
      return "probe";
    case Source::kFull:
      return "full";
    case Source::kForced:
      return "forced";
  }
  return "";
}

std::vector<std::string> DecisionNames() {
  std::vector<std::string> names;
  for (const Rule& rule : Rules()) names.emplace_back(rule.name);
  return names;
}

render::TracingPlan ExactTracing(const scene::Scene& scene, bool has_environment) {
  const SceneFacts facts = FactsOf(scene, has_environment);
  const RuleInput input = {facts, Probe(), PlanSettings()};
  Plan plan;
  for (const Rule& rule : Rules()) {
    if (rule.exact) rule.apply(input, rule.decide(input, plan).value, &plan);
  }
  return plan.tracing;
}

absl::StatusOr<Plan> MakePlan(const scene::Scene& scene, const PlanSettings& settings, const Probe& probe) {
  const auto forced = ParseForced(settings.forced);
  if (!forced.ok()) return forced.status();
  const SceneFacts facts = FactsOf(scene, settings.render.environment != nullptr);
  const RuleInput input = {facts, probe, settings};
  Plan plan;
  for (const Rule& rule : Rules()) {
    Verdict verdict = Decide(rule, input, *forced, plan);
    rule.apply(input, verdict.value, &plan);
    plan.decisions.push_back({std::string(rule.name), ValueText(rule, verdict.value), verdict.source,
                              std::move(verdict.reason), std::move(verdict.saving),
                              std::string(rule.governs)});
  }
  plan.probe_rays = probe.rays;
  plan.probe_seconds = static_cast<double>(probe.rays) / settings.rays_per_second;
  plan.noise = probe.noise;
  plan.seconds_per_sample = double{1} * settings.render.width * settings.render.height *
                            probe.RaysPerSample() / settings.rays_per_second;
  return plan;
}

}  // namespace lumifold::plan
