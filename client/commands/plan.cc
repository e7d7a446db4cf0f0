#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/job_options.h"
#include "client/reports/plan_report.h"

namespace lumifold::client {
namespace {

struct PlanOptions {
  JobOptions job;
  bool json = false;
};

std::optional<ExitCode> ParsePlan(const std::vector<std::string>& arguments, const Environment& environment,
                                  PlanOptions* options) {
  CommandLine command_line(WordsOf("plan"));
  AddJobOptions(command_line, &options->job);
  AddJson(command_line, &options->json);
  command_line.SetFooter(
      "Takes the options of 'render' that determine the picture. Traces a few samples of the first frame at "
      "low\n"
      "resolution; writes no picture. docs/plan.md explains each decision.");
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  return CheckJobOptions("lumifold plan", environment, &options->job);
}

}  // namespace

ExitCode RunPlan(const std::vector<std::string>& arguments, const Environment& environment) {
  PlanOptions options;
  if (const auto ended = ParsePlan(arguments, environment, &options)) return *ended;
  if (!environment.local.scene_planner)
    return ReportError(environment, absl::UnimplementedError("this build has no worker, which plans"));
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(options.job);
  if (!assets.ok()) return ReportError(environment, assets.status());
  v1::JobSpec spec = MakeJobSpec(options.job);
  *spec.mutable_scene() = MakeSceneRef(*assets);
  const absl::StatusOr<v1::Plan> plan = environment.local.scene_planner(spec, *assets);
  if (!plan.ok()) return ReportError(environment, plan.status());
  environment.out << (options.json ? PlanJson(*plan) + "\n" : PlanTable(*plan)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
