#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/preview_options.h"
#include "client/commands/shared_options.h"
#include "client/farm/follow_job.h"
#include "client/farm/submit_scene.h"
#include "client/options/hook.h"
#include "client/options/job_options.h"
#include "client/options/scheduling_options.h"
#include "client/reports/job_report.h"
#include "client/scene/assets.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::client {
namespace {

constexpr char kCommand[] = "lumifold submit";

struct SubmitOptions {
  explicit SubmitOptions(const Environment& environment) : scheduling(environment), remote(environment) {
    picture.threads = environment.defaults.threads;
  }

  JobOptions job;
  SchedulingOptions scheduling;
  bool is_unchecked = false;
  bool waits = false;
  PictureOptions picture;
  std::string preview;
  Hook hook;
  RemoteOptions remote;

  /// Whether the command goes on until the job has ended.
  bool Follows() const {
    return waits || !picture.output.empty() || !preview.empty() || !hook.command.empty();
  }
};

std::optional<ExitCode> ParseSubmit(const std::vector<std::string>& arguments, const Environment& environment,
                                    SubmitOptions* options) {
  CommandLine command_line(WordsOf("submit"));
  AddJobOptions(command_line, &options->job);
  options->scheduling.AddTo(command_line);
  command_line.AddFlag("--unchecked", &options->is_unchecked,
                       "Upload the scene without reading it first: the farm says what it cannot render");
  command_line.AddFlag("--wait", &options->waits,
                       "Show progress until the job has ended; the exit code is its outcome");
  options->picture.AddTo(command_line, "--download", /*is_required=*/false);
  AddPreview(command_line, &options->preview);
  options->hook.AddTo(command_line);
  options->remote.AddTo(command_line);
  command_line.SetFooter(
      "--download, --preview and --hook imply --wait. Ctrl-C then ends this command, not the job.");
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  if (const auto ended = CheckJobOptions(kCommand, environment, &options->job)) return ended;
  if (const auto ended = CheckPreview(options->preview, kCommand, environment)) return ended;
  if (options->picture.output.empty() && options->picture.noisy.empty()) return std::nullopt;
  return options->picture.Check(options->job.view.frames, kCommand, environment);
}

/// What is wrong with the scene is said before it is uploaded.
absl::Status CheckScene(v1::JobSpec spec, const SceneAssets& assets, const Environment& environment) {
  if (!environment.local.scene_check) return absl::OkStatus();
  *spec.mutable_scene() = MakeSceneRef(assets);
  const absl::Status status = environment.local.scene_check(spec, assets);
  return absl::IsInvalidArgument(status) ? OfThisMachine(status) : status;
}

absl::StatusOr<std::string> Submit(const SubmitOptions& options, FarmClient& farm, Progress& progress,
                                   const Environment& environment) {
  v1::Scheduling scheduling = options.scheduling.ToProto();
  for (std::string& job : *scheduling.mutable_after()) {
    if (const auto found = options.remote.ConnectFor(&job, environment); !found.ok()) return found.status();
  }
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(options.job);
  if (!assets.ok()) return assets.status();
  v1::SubmitJobRequest request;
  *request.mutable_spec() = MakeJobSpec(options.job);
  const absl::Status checked =
      options.is_unchecked ? absl::OkStatus() : CheckScene(request.spec(), *assets, environment);
  if (!checked.ok()) return checked;
  *request.mutable_scheduling() = std::move(scheduling);
  return SubmitScene(farm, *assets, std::move(request), progress, options.remote.MakeBackoff(environment));
}

ExitCode Follow(const SubmitOptions& options, const std::string& job_id, FarmClient& farm, Progress& progress,
                const Environment& environment) {
  const int first = options.job.view.frames.first();
  const std::unique_ptr<PreviewFile> preview = StartPreview(
      options.remote.Connect(environment),
      {.job_id = job_id, .frame = first, .path = options.preview, .display = options.picture.display});
  const absl::StatusOr<v1::JobStatus> job =
      FollowJob(farm, job_id, progress, options.remote.MakeBackoff(environment), [](const v1::JobStatus&) {});
  if (!job.ok()) return ReportError(environment, job.status());
  ExitCode outcome = ReportOutcome(environment, *job);
  absl::Status written = preview == nullptr ? absl::OkStatus() : preview->Stop();
  const bool downloads = IsDone(*job) && !options.picture.output.empty();
  if (written.ok() && downloads)
    written = options.picture.FetchAll(farm, *job, options.job.view.frames, progress,
                                       options.remote.MakeBackoff(environment));
  if (!written.ok()) outcome = ReportError(environment, written);
  const std::string output = downloads ? options.picture.OutputOf(*job, first) : "";
  if (downloads && written.ok())
    ReportLine(environment,
               absl::StrCat("wrote ", FilesOf(options.picture.output, *job, options.job.view.frames)));
  if (options.remote.json) environment.out << JobJson(*job) << "\n" << std::flush;
  return RunHook(options.hook, *job, output, outcome, environment);
}

}  // namespace

ExitCode RunSubmit(const std::vector<std::string>& arguments, const Environment& environment) {
  SubmitOptions options(environment);
  if (const auto ended = ParseSubmit(arguments, environment, &options)) return *ended;
  const std::unique_ptr<FarmClient> farm = options.remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const absl::StatusOr<std::string> job_id = Submit(options, *farm, *progress, environment);
  if (!job_id.ok()) return ReportError(environment, job_id.status());
  nlohmann::ordered_json json{{"job_id", *job_id}};
  if (const std::string trace_id = rpc::TraceIdOf(environment.trace_parent); !trace_id.empty())
    json["trace_id"] = trace_id;
  environment.out << (options.remote.json ? JsonLine(json) : *job_id) << "\n" << std::flush;
  return options.Follows() ? Follow(options, *job_id, *farm, *progress, environment) : ExitCode::kOk;
}

}  // namespace lumifold::client
