#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/job_options.h"

namespace lumifold::client {
namespace {

struct PlanCommandOptions {
  JobOptions job;
  std::string plan = "auto";
  PlanOptions options;
  bool json = false;
};

std::optional<ExitCode> ParsePlan(const std::vector<std::string>& arguments, const Environment& environment,
                                  PlanCommandOptions* options) {
  CommandLine command_line("plan", SummaryOf("plan"));
  AddJobOptions(command_line, &options->job);
  command_line.AddText(
      "--plan", "WHICH", &options->plan,
      "'auto': leave out what the scene does not need; 'full': model everything (default auto)");
  command_line.AddTexts("--force", "NAME=VALUE", &options->options.forced,
                        "Override a decision of the plan; repeatable");
  AddJson(command_line, &options->json);
  command_line.SetFooter(
      "Takes the options of 'render' that determine the picture. Traces a few samples of the first frame at "
      "low\n"
      "resolution; writes no picture. docs/plan.md explains each decision.");
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  if (const auto ended = CheckJobOptions(options->job, "lumifold plan", environment)) return ended;
  if (options->plan != "auto" && options->plan != "full") {
    return ReportUsage(environment, "lumifold plan",
                       absl::StrCat("--plan: expected 'auto' or 'full'; got '", options->plan, "'"));
  }
  options->options.full = options->plan == "full";
  return std::nullopt;
}

}  // namespace

ExitCode RunPlan(const std::vector<std::string>& arguments, const Environment& environment) {
  PlanCommandOptions options;
  if (const auto ended = ParsePlan(arguments, environment, &options)) return *ended;
  if (!environment.scene_planner)
    return ReportError(environment, absl::UnimplementedError("this build has no worker, which plans"));
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(options.job);
  if (!assets.ok()) return ReportError(environment, assets.status());
  v1::JobSpec spec = MakeJobSpec(options.job);
  *spec.mutable_scene() = MakeSceneRef(*assets);
  const absl::StatusOr<PlanTexts> plan = environment.scene_planner(spec, *assets, options.options);
  if (!plan.ok()) return ReportError(environment, plan.status());
  environment.out << (options.json ? plan->json : plan->table) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
