#pragma once

#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"
#include "worker/units/job_scene.h"

namespace lumifold::worker {

/// Plans a job by its first frame, `scene`: reads it, traces the probe and decides. The result is a function
/// of scene, spec and numeric class. Texts are cut to rpc::kMaxReasonBytes.
/// Errors: those of plan::RunProbe, naming the scene, and of plan::MakePlan.
absl::StatusOr<v1::Plan> PlanJob(const v1::JobSpec& spec, const JobScene& scene);

/// Lets the renderer obey the plan of a job. No effect on a job without one: everything is modelled.
void ApplyPlan(const v1::JobSpec& spec, render::RenderSettings* settings);

}  // namespace lumifold::worker
