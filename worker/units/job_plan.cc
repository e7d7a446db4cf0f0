#include "worker/units/job_plan.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "server/job/frame_list.h"
#include "worker/plan/plan.h"
#include "worker/plan/probe.h"

namespace lumifold::worker {
namespace {

v1::DecisionSource ProtoFromSource(plan::Source source) {
  switch (source) {
    case plan::Source::kScene:
      return v1::DECISION_SOURCE_SCENE;
    case plan::Source::kProbe:
      return v1::DECISION_SOURCE_PROBE;
    case plan::Source::kFull:
      return v1::DECISION_SOURCE_FULL;
    case plan::Source::kForced:
      return v1::DECISION_SOURCE_FORCED;
  }
  return v1::DECISION_SOURCE_UNSPECIFIED;
}

v1::Plan ProtoFromPlan(const plan::Plan& plan) {
  v1::Plan proto;
  for (const plan::Decision& decision : plan.decisions) {
    v1::PlanDecision* out = proto.add_decisions();
    out->set_name(decision.name);
    out->set_value(decision.value);
    out->set_source(ProtoFromSource(decision.source));
    out->set_reason(rpc::BoundedLine(decision.reason, rpc::kMaxReasonBytes));
    out->set_saving(rpc::BoundedLine(decision.saving, rpc::kMaxReasonBytes));
  }
  proto.set_probe_rays(plan.probe_rays);
  proto.set_probe_seconds(plan.probe_seconds);
  proto.set_seconds_per_sample(plan.seconds_per_sample);
  proto.set_noise(plan.noise);
  proto.set_memory_bytes(plan.memory_bytes);
  for (const int tile : plan.units.tile_order) proto.add_tile_order(tile);
  return proto;
}

/// What the job asks for itself counts as forced.
std::vector<std::string> ForcedOf(const v1::JobSpec& spec) {
  const auto& forced = spec.planning().forced();
  std::vector<std::string> all(forced.begin(), forced.end());
  if (spec.tile_size() > 0)
    all.push_back(absl::StrCat(std::string(decisions::kTileSize), "=", spec.tile_size()));
  if (spec.pass_samples() > 0)
    all.push_back(absl::StrCat(std::string(decisions::kPassSamples), "=", spec.pass_samples()));
  return all;
}

}  // namespace

absl::StatusOr<v1::Plan> PlanJob(const v1::JobSpec& spec, const JobScene& scene) {
  plan::PlanSettings settings;
  settings.render = scene.settings;
  settings.samples = spec.samples_per_pixel();
  settings.frames = job::FrameList(spec).count();
  settings.full = spec.planning().mode() == v1::PLAN_MODE_FULL;
  settings.forced = ForcedOf(spec);
  settings.file_bytes = spec.scene().file().size();
  for (const v1::AssetRef& asset : spec.scene().dependencies()) settings.file_bytes += asset.size();
  const absl::StatusOr<plan::Probe> probe = plan::RunProbe(*scene.scene, settings.render, settings.samples);
  if (!probe.ok()) return NamingScene(probe.status(), spec);
  const absl::StatusOr<plan::Plan> plan = plan::MakePlan(*scene.scene, settings, *probe);
  if (!plan.ok()) return plan.status();
  return ProtoFromPlan(*plan);
}

void ApplyPlan(const v1::JobSpec& spec, render::RenderSettings* settings) {
  if (!spec.has_plan()) return;
  plan::Plan plan;
  plan.max_bounces = settings->max_bounces;
  for (const v1::PlanDecision& decision : spec.plan().decisions())
    plan::Apply(decision.name(), decision.value(), &plan);
  settings->max_bounces = plan.max_bounces;
  settings->plan = plan.tracing;
}

}  // namespace lumifold::worker
