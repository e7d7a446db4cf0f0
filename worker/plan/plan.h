#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/plan/probe.h"
#include "worker/render/renderer.h"
#include "worker/render/tracing/tracing_plan.h"
#include "worker/scene/scene.h"

/// What a scene needs modelled: see docs/plan.md.
namespace lumifold::plan {

/// Rays that a thread traces and shades in a second: the order of magnitude on the processors of 2020, by
/// which rays become seconds. A machine twice as fast gets units half as long, and the other way round; the
/// picture does not depend on it.
inline constexpr double kRaysPerSecond = 2e6;

/// A unit of less than this many seconds costs too much beside its tracing.
inline constexpr double kMinUnitSeconds = 2;

/// What a plan depends on besides the scene.
struct PlanSettings {
  render::RenderSettings render;    // its plan is not read
  int samples = 64;                 // per pixel
  int frames = 1;                   // of the job
  bool full = false;                // model everything
  std::vector<std::string> forced;  // "NAME=VALUE": decisions to override, also those of `full`
  double rays_per_second = kRaysPerSecond;
  uint64_t file_bytes = 0;  // of the scene's files
};

/// Who decided.
enum class Source { kScene, kProbe, kFull, kForced };

/// One decision, as people and programs read it.
struct Decision {
  std::string name;  // one of decisions::kAll
  int value = 1;
  Source source = Source::kScene;
  std::string reason;  // one line, with the facts
  std::string saving;  // what it saves; empty: nothing
};

/// How a frame is divided into units.
struct UnitPlan {
  int tile_size = 32;
  int pass_samples = 0;  // even; 0: the coordinator's default
  bool costliest_first = false;
  std::vector<int> tile_order;  // tile numbers, row-major, the costliest first; empty: in order of number
};

struct Plan {
  render::TracingPlan tracing;  // for RenderSettings::plan
  int max_bounces = 8;          // for RenderSettings::max_bounces
  UnitPlan units;
  std::vector<Decision> decisions;
  int64_t probe_rays = 0;         // the plan's cost
  double probe_seconds = 0;       // by PlanSettings::rays_per_second
  double noise = 0;               // Probe::noise
  uint64_t memory_bytes = 0;      // SceneMemory
  double seconds_per_sample = 0;  // estimate of tracing one sample of every pixel on one thread
};

/// Makes the plan, a pure function, with the decisions of decisions::kAll in their order. `scene` is frame 0,
/// or any one frame, of the job.
/// Errors: kInvalidArgument for a forced decision that does not exist or cannot have that value, naming those
/// that can.
absl::StatusOr<Plan> MakePlan(const scene::Scene& scene, const PlanSettings& settings, const Probe& probe);

/// Sets what one decision governs. No effect for a name that does not exist, or for the order of tiles, which
/// needs the probe.
void Apply(std::string_view decision, int value, Plan* plan);

}  // namespace lumifold::plan
