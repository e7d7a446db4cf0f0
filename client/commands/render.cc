#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/preview_options.h"
#include "client/commands/shared_options.h"
#include "client/farm/download.h"
#include "client/farm/follow_job.h"
#include "client/farm/submit_scene.h"
#include "client/options/job_options.h"
#include "client/options/scheduling_options.h"
#include "client/pictures/output_template.h"
#include "client/reports/job_report.h"
#include "client/scene/assets.h"

namespace lumifold::client {
namespace {

/// The stages as they are on one machine, where nothing is sent.
class LocalStages final : public Progress {
 public:
  explicit LocalStages(std::unique_ptr<Progress> shown) : shown_(std::move(shown)) {}

  void Update(const ProgressState& state) override {
    ProgressState local = state;
    if (state.stage == "uploading") local.stage = "reading the scene";
    if (state.stage == "downloading") local.stage = "writing";
    shown_->Update(local);
  }
  void Message(absl::string_view line) override { shown_->Message(line); }
  void Clear() override { shown_->Clear(); }

 private:
  const std::unique_ptr<Progress> shown_;
};

struct RenderOptions {
  JobOptions job;
  PictureOptions picture;
  std::string name;
  std::string preview;
  Hook hook;
  LocalFarmOptions farm;
  bool json = false;
};

std::optional<ExitCode> ParseRender(const std::vector<std::string>& arguments, const Environment& environment,
                                    RenderOptions* options) {
  options->farm.threads = environment.defaults.threads;
  options->picture.threads = environment.defaults.threads;
  CommandLine command_line(WordsOf("render"));
  AddJobOptions(command_line, &options->job);
  options->picture.AddTo(command_line, "-o,--output", /*is_required=*/true);
  AddJobName(command_line, &options->name);
  AddPreview(command_line, &options->preview);
  options->hook.AddTo(command_line);
  command_line.AddWholeNumber("--threads", &options->farm.threads, 1, kMaxThreads,
                              "Threads to render with (default: all of this machine)");
  AddDevice(command_line, &options->farm.device, &options->farm.allows_other_bits);
  command_line.AddText("--state", "DIR", &options->farm.state_dir,
                       "Data folder for ledger and results (default: a temporary folder)");
  AddJson(command_line, &options->json);
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  if (const auto ended = CheckJobOptions("lumifold render", environment, &options->job)) return ended;
  if (const auto ended = CheckPreview(options->preview, "lumifold render", environment)) return ended;
  return options->picture.Check(options->job.view.frames, "lumifold render", environment);
}

// Submits the job and follows it to its end; cancels it if the user interrupts. `viewer` is for the preview.
absl::StatusOr<v1::JobStatus> RunJob(FarmClient& farm, std::unique_ptr<FarmClient> viewer,
                                     const RenderOptions& options, const SceneAssets& assets,
                                     Progress& progress, const Environment& environment) {
  v1::SubmitJobRequest request;
  *request.mutable_spec() = MakeJobSpec(options.job);
  request.mutable_scheduling()->set_name(options.name);
  const absl::StatusOr<std::string> job_id =
      SubmitScene(farm, assets, std::move(request), progress, MakeBackoff(environment));
  if (!job_id.ok()) return job_id.status();
  const std::unique_ptr<PreviewFile> preview =
      StartPreview(std::move(viewer), {.job_id = *job_id,
                                       .frame = options.job.view.frames.first(),
                                       .path = options.preview,
                                       .display = options.picture.display});
  absl::StatusOr<v1::JobStatus> job =
      FollowJob(farm, *job_id, progress, MakeBackoff(environment), [](const v1::JobStatus&) {});
  if (absl::IsCancelled(job.status())) {
    progress.Clear();
    farm.CancelJob(*job_id).IgnoreError();  // the farm ends with this process anyway
  }
  const absl::Status shown = preview == nullptr ? absl::OkStatus() : preview->Stop();
  if (job.ok() && !shown.ok()) return shown;
  return job;
}

absl::Status WritePicture(FarmClient& farm, const PictureOptions& picture, const v1::JobStatus& job,
                          int frame, Progress& progress, const Environment& environment) {
  // The local farm ends with this command, so a partial download cannot be resumed.
  const absl::Cleanup remove_part = [&] {
    std::error_code ignored;
    const absl::StatusOr<std::string> part = PartPath(picture.OutputOf(job, frame), job.job_id(), frame);
    if (part.ok()) std::filesystem::remove(*part, ignored);
  };
  return picture.Fetch(farm, job, frame, progress, MakeBackoff(environment));
}

absl::Status WritePictures(FarmClient& farm, const RenderOptions& options, const v1::JobStatus& job,
                           Progress& progress, const Environment& environment) {
  for (const FrameRange& range : options.job.view.frames.ranges) {
    for (int frame = range.first; frame <= range.last; ++frame) {
      absl::Status written = WritePicture(farm, options.picture, job, frame, progress, environment);
      if (!written.ok()) return written;
    }
  }
  return absl::OkStatus();
}

void ReportRendered(const RenderOptions& options, const v1::JobStatus& job, const Environment& environment) {
  const PictureOptions& picture = options.picture;
  const Frames& frames = options.job.view.frames;
  if (options.json) {
    const auto name = [&](const std::string& path) {
      return frames.IsOne() ? PathOfOutput(path, job, frames.first()) : path;
    };
    std::vector<std::pair<std::string, std::string>> files{{"output", name(picture.output)}};
    if (!picture.noisy.empty()) files.emplace_back("noisy_output", name(picture.noisy));
    environment.out << JobJson(job, files) << "\n" << std::flush;
  }
  if (!picture.noisy.empty())
    ReportLine(environment, absl::StrCat("wrote ", FilesOf(picture.noisy, job, frames)));
  ReportLine(environment, absl::StrCat("wrote ", FilesOf(picture.output, job, frames), " (",
                                       StageTimesText(job.times()), ")"));
}

}  // namespace

ExitCode RunRender(const std::vector<std::string>& arguments, const Environment& environment) {
  RenderOptions options;
  if (const auto ended = ParseRender(arguments, environment, &options)) return *ended;
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(options.job);
  if (!assets.ok()) return ReportError(environment, assets.status());

  if (!environment.local.farm) {
    return ReportError(environment,
                       absl::UnimplementedError("this build has no coordinator and worker; use submit"));
  }
  const absl::StatusOr<std::unique_ptr<LocalFarm>> local = environment.local.farm(options.farm);
  if (!local.ok()) return ReportError(environment, OfThisMachine(local.status()));
  const auto connect = [&] {
    return MakeFarmClient((*local)->channel(), {.coordinators = {"this process"},
                                                .time = environment.time,
                                                .interrupted = environment.interrupted,
                                                .trace_parent = environment.trace_parent});
  };
  const std::unique_ptr<FarmClient> farm = connect();
  LocalStages progress(MakeProgressPrinter(environment));
  const absl::StatusOr<v1::JobStatus> job = RunJob(*farm, connect(), options, *assets, progress, environment);
  for (const std::string& line : (*local)->Warnings()) progress.Message(line);
  if (!job.ok()) return ReportError(environment, job.status());
  if (job->state() != v1::JOB_STATE_DONE)
    return RunHook(options.hook, *job, "", ReportOutcome(environment, *job), environment);
  const absl::Status written = WritePictures(*farm, options, *job, progress, environment);
  if (!written.ok()) return ReportError(environment, written);
  ReportRendered(options, *job, environment);
  const std::string output = options.picture.OutputOf(*job, options.job.view.frames.first());
  return RunHook(options.hook, *job, output, ExitCode::kOk, environment);
}

}  // namespace lumifold::client
