#include "worker/plan/plan.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"
#include "worker/plan/plan_rules.h"
#include "worker/plan/scene_memory.h"

namespace lumifold::plan {
namespace {

/// The value of a decision that models everything.
int FullValue(const decisions::Decision& decision, const RuleInput& input) {
  return decision.name == decisions::kBounces ? input.settings.render.max_bounces : decision.full;
}

Verdict Decide(const Rule& rule, const decisions::Decision& decision, const RuleInput& input,
               const decisions::Values& forced, const Plan& so_far) {
  Verdict verdict = rule.decide(input, so_far);
  if (input.settings.full)
    verdict = {FullValue(decision, input), Source::kFull, "everything is modelled", /*saving=*/""};
  const auto found = forced.find(decision.name);
  if (found == forced.end()) return verdict;
  return {found->second, Source::kForced,
          absl::StrCat("asked for; otherwise ", decisions::ValueText(decision, verdict.value), ": ",
                       verdict.reason),
          /*saving=*/""};
}

}  // namespace

void Apply(std::string_view decision, int value, Plan* plan) {
  for (const Rule& rule : Rules()) {
    if (rule.name == decision) rule.apply(value, plan);
  }
}

absl::StatusOr<Plan> MakePlan(const scene::Scene& scene, const PlanSettings& settings, const Probe& probe) {
  const auto forced = decisions::ParseForced(settings.forced);
  if (!forced.ok()) return forced.status();
  const SceneFacts facts = FactsOf(scene, settings.render.environment != nullptr);
  const RuleInput input = {facts, probe, settings};
  Plan plan;
  for (const Rule& rule : Rules()) {
    Verdict verdict = Decide(rule, *decisions::Find(rule.name), input, *forced, plan);
    rule.apply(verdict.value, &plan);
    plan.decisions.push_back({std::string(rule.name), verdict.value, verdict.source,
                              std::move(verdict.reason), std::move(verdict.saving)});
  }
  if (plan.units.costliest_first) plan.units.tile_order = CostliestFirst(input, plan);
  plan.probe_rays = probe.rays;
  plan.probe_seconds = static_cast<double>(probe.rays) / settings.rays_per_second;
  plan.noise = probe.noise;
  const auto& sky = settings.render.environment;
  plan.memory_bytes = SceneMemory(scene, settings.file_bytes, sky == nullptr ? 0 : sky->bytes());
  plan.seconds_per_sample = double{1} * settings.render.width * settings.render.height *
                            probe.RaysPerSample() / settings.rays_per_second;
  return plan;
}

}  // namespace lumifold::plan
