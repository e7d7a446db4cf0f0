#include "server/job/plan.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"
#include "server/job/job_spec.h"
#include "server/job/limits.h"
#include "server/job/tile_grid.h"

namespace lumifold::job {
namespace {

using decisions::Decision;

absl::Status Invalid(const auto&... text) {
  return absl::InvalidArgumentError(absl::StrCat("plan: ", text...));
}

const v1::PlanDecision* FindDecision(const v1::Plan& plan, std::string_view name) {
  const auto found = std::find_if(plan.decisions().begin(), plan.decisions().end(),
                                  [name](const v1::PlanDecision& d) { return d.name() == name; });
  return found == plan.decisions().end() ? nullptr : &*found;
}

/// The values that a job demands: those it forces, and those of its own fields.
absl::StatusOr<decisions::Values> DemandedValues(const v1::JobSpec& spec) {
  const auto& forced = spec.planning().forced();
  absl::StatusOr<decisions::Values> values =
      decisions::ParseForced(std::vector<std::string>(forced.begin(), forced.end()));
  if (!values.ok()) return values;
  if (spec.tile_size() > 0) (*values)[decisions::kTileSize] = spec.tile_size();
  if (spec.pass_samples() > 0) (*values)[decisions::kPassSamples] = spec.pass_samples();
  return values;
}

absl::Status CheckDecision(const Decision& rule, const v1::PlanDecision& decision,
                           const decisions::Values& demanded) {
  if (decision.name() != rule.name)
    return Invalid("the decision '", std::string(rule.name), "' is missing or out of order");
  if (decision.value() < rule.least || decision.value() > rule.most) {
    return Invalid(decision.name(), " is ", decision.value(), ", not ", rule.least, " to ", rule.most);
  }
  const auto demand = demanded.find(rule.name);
  if (demand != demanded.end() && decision.value() != demand->second)
    return Invalid(decision.name(), " is ", decision.value(), ", but the job asks for ", demand->second);
  if ((demand != demanded.end()) != (decision.source() == v1::DECISION_SOURCE_FORCED) ||
      !v1::DecisionSource_IsValid(decision.source()))
    return Invalid(decision.name(), " has the wrong source");
  if (decision.reason().size() > kMaxPlanTextBytes || decision.saving().size() > kMaxPlanTextBytes)
    return Invalid("a text of ", decision.name(), " has more than ", kMaxPlanTextBytes, " bytes");
  return absl::OkStatus();
}

absl::Status CheckDecisions(const v1::JobSpec& spec, const v1::Plan& plan) {
  const absl::StatusOr<decisions::Values> demanded = DemandedValues(spec);
  if (!demanded.ok()) return demanded.status();
  if (plan.decisions_size() != static_cast<int>(decisions::kAll.size()))
    return Invalid("it has ", plan.decisions_size(), " decisions, not ", decisions::kAll.size());
  for (int i = 0; i < plan.decisions_size(); ++i) {
    if (absl::Status status =
            CheckDecision(decisions::kAll[static_cast<size_t>(i)], plan.decisions(i), *demanded);
        !status.ok())
      return status;
  }
  if (FindDecision(plan, decisions::kBounces)->value() > spec.max_bounces() &&
      !demanded->contains(decisions::kBounces))
    return Invalid("more bounces than the job asks for");
  return absl::OkStatus();
}

absl::Status CheckNumbers(const v1::Plan& plan) {
  const auto is_amount = [](double value) { return std::isfinite(value) && value >= 0; };
  if (plan.probe_rays() >= 0 && is_amount(plan.probe_seconds()) && is_amount(plan.seconds_per_sample()) &&
      is_amount(plan.noise()))
    return absl::OkStatus();
  return Invalid("a number is negative or not finite");
}

}  // namespace

bool NeedsPlan(const v1::JobSpec& spec) {
  return spec.planning().mode() == v1::PLAN_MODE_AUTO && !spec.has_plan();
}

v1::JobSpec FirstFrameOf(v1::JobSpec spec) {
  spec.set_frame_count(1);
  spec.clear_more_frames();
  return spec;
}

absl::StatusOr<v1::Plan> FullPlan(const v1::JobSpec& spec) {
  const auto& forced = spec.planning().forced();
  const absl::StatusOr<decisions::Values> values =
      decisions::ParseForced(std::vector<std::string>(forced.begin(), forced.end()));
  if (!values.ok()) return values.status();
  v1::Plan plan;
  for (const Decision& rule : decisions::kAll) {
    v1::PlanDecision* decision = plan.add_decisions();
    decision->set_name(std::string(rule.name));
    decision->set_value(rule.full);
    if (rule.name == decisions::kBounces) decision->set_value(spec.max_bounces());
    decision->set_source(v1::DECISION_SOURCE_FULL);
    decision->set_reason("everything is modelled");
    const auto found = values->find(rule.name);
    if (found != values->end()) {
      decision->set_value(found->second);
      decision->set_source(v1::DECISION_SOURCE_FORCED);
      decision->set_reason(rule.name == decisions::kCostliestFirst && found->second != 0
                               ? "asked for, but without a probe no costs are known: no effect"
                               : "asked for");
    }
    if (rule.name == decisions::kTileSize) decision->set_value(spec.tile_size());
    if (rule.name == decisions::kPassSamples) decision->set_value(spec.pass_samples());
  }
  return plan;
}

absl::StatusOr<v1::JobSpec> PlannedSpec(const v1::JobSpec& spec, const v1::Plan& plan) {
  if (plan.ByteSizeLong() > kMaxPlanBytes)
    return Invalid("it has ", plan.ByteSizeLong(), " bytes, more than ", kMaxPlanBytes);
  if (absl::Status status = CheckDecisions(spec, plan); !status.ok()) return status;
  if (absl::Status status = CheckNumbers(plan); !status.ok()) return status;
  v1::JobSpec planned = spec;
  *planned.mutable_plan() = plan;
  if (planned.tile_size() == 0) planned.set_tile_size(FindDecision(plan, decisions::kTileSize)->value());
  if (planned.pass_samples() == 0)
    SetPassSamples(FindDecision(plan, decisions::kPassSamples)->value(), &planned);
  absl::StatusOr<v1::JobSpec> normalised = NormaliseJobSpec(std::move(planned));
  if (!normalised.ok()) return Invalid(std::string(normalised.status().message()));
  return normalised;
}

absl::Status CheckTileOrder(const v1::JobSpec& spec) {
  const auto& order = spec.plan().tile_order();
  if (order.empty()) return absl::OkStatus();
  if (ValueOf(spec, decisions::kCostliestFirst) == 0)
    return absl::InvalidArgumentError("tile_order is set, but costliest-first is off");
  const int tiles = TileGrid(spec.width(), spec.height(), spec.tile_size()).count();
  std::vector<int32_t> sorted(order.begin(), order.end());
  std::sort(sorted.begin(), sorted.end());
  bool is_order = order.size() == tiles;
  for (int i = 0; is_order && i < tiles; ++i) is_order = sorted[static_cast<size_t>(i)] == i;
  if (is_order) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("tile_order does not have each of the ", tiles, " tiles once"));
}

v1::JobSpec UnplannedSpec(v1::JobSpec spec) {
  const auto is_planned = [&spec](std::string_view name) {
    const v1::PlanDecision* decision = FindDecision(spec.plan(), name);
    return decision != nullptr && decision->source() != v1::DECISION_SOURCE_FORCED;
  };
  if (spec.planning().mode() != v1::PLAN_MODE_AUTO || !spec.has_plan()) return spec;
  if (is_planned(decisions::kTileSize)) spec.clear_tile_size();
  if (is_planned(decisions::kPassSamples)) {
    spec.clear_pass_samples();
    spec.clear_first_pass_samples();
  }
  spec.clear_plan();
  return spec;
}

uint64_t MemoryNeedOf(const v1::JobSpec& spec) {
  if (spec.plan().memory_bytes() > 0) return spec.plan().memory_bytes();
  uint64_t bytes = spec.scene().file().size();
  for (const v1::AssetRef& asset : spec.scene().dependencies()) bytes += asset.size();
  return bytes;
}

int ValueOf(const v1::JobSpec& spec, std::string_view name) {
  const v1::PlanDecision* decision = FindDecision(spec.plan(), name);
  return decision != nullptr ? decision->value() : decisions::Find(name)->full;
}

}  // namespace lumifold::job
