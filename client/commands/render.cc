#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "client/assets.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/shared_options.h"
#include "client/download.h"
#include "client/follow_job.h"
#include "client/job_options.h"
#include "client/job_report.h"
#include "client/submit_scene.h"

namespace lumifold::client {
namespace {

constexpr int kMaxThreads = 4096;

struct RenderOptions {
  JobOptions job;
  PictureOptions picture;
  LocalFarmOptions farm;
  bool json = false;
};

std::optional<ExitCode> ParseRender(const std::vector<std::string>& arguments, const Environment& environment,
                                    RenderOptions* options) {
  options->farm.threads = environment.default_threads;
  CommandLine command_line("render", SummaryOf("render"));
  AddJobOptions(command_line, &options->job);
  options->picture.AddTo(command_line);
  command_line.AddWholeNumber("--threads", &options->farm.threads, 1, kMaxThreads,
                              "Threads to render with (default: all of this machine)");
  command_line.AddText("--state", "DIR", &options->farm.state_dir,
                       "Data folder for ledger and results (default: a temporary folder)");
  AddJson(command_line, &options->json);
  if (const auto ended = command_line.Parse(arguments, environment)) return ended;
  if (const auto ended = CheckJobOptions(options->job, "lumifold render", environment)) return ended;
  return options->picture.Check(options->job.frames, "lumifold render", environment);
}

// Submits the job and follows it to its end; cancels it if the user interrupts.
absl::StatusOr<v1::JobStatus> RunJob(FarmClient& farm, const RenderOptions& options,
                                     const SceneAssets& assets, Progress& progress,
                                     const Environment& environment) {
  v1::SubmitJobRequest request;
  *request.mutable_spec() = MakeJobSpec(options.job);
  const absl::StatusOr<std::string> job_id =
      SubmitScene(farm, assets, std::move(request), progress, MakeBackoff(environment));
  if (!job_id.ok()) return job_id.status();
  absl::StatusOr<v1::JobStatus> job =
      FollowJob(farm, *job_id, progress, MakeBackoff(environment), [](const v1::JobStatus&) {});
  if (absl::IsCancelled(job.status())) {
    progress.Clear();
    farm.CancelJob(*job_id).IgnoreError();  // the farm ends with this process anyway
  }
  return job;
}

absl::Status WritePicture(FarmClient& farm, const PictureOptions& picture, const std::string& job_id,
                          int frame, Progress& progress, const Environment& environment) {
  // The local farm ends with this command, so a partial download cannot be resumed.
  const absl::Cleanup remove_part = [&] {
    std::error_code ignored;
    const absl::StatusOr<std::string> part = PartPath(PathOfFrame(picture.output, frame), job_id, frame);
    if (part.ok()) std::filesystem::remove(*part, ignored);
  };
  return picture.Fetch(farm, job_id, frame, progress, MakeBackoff(environment));
}

absl::Status WritePictures(FarmClient& farm, const RenderOptions& options, const std::string& job_id,
                           Progress& progress, const Environment& environment) {
  for (const FrameRange& range : options.job.frames.ranges) {
    for (int frame = range.first; frame <= range.last; ++frame) {
      absl::Status written = WritePicture(farm, options.picture, job_id, frame, progress, environment);
      if (!written.ok()) return written;
    }
  }
  return absl::OkStatus();
}

/// "out.exr", or "out.0001.exr to out.0048.exr".
std::string FilesOf(const std::string& path, const Frames& frames) {
  const std::string first = PathOfFrame(path, frames.first());
  return frames.IsOne() ? first : absl::StrCat(first, " to ", PathOfFrame(path, frames.last()));
}

void ReportRendered(const RenderOptions& options, const v1::JobStatus& job, const Environment& environment) {
  const PictureOptions& picture = options.picture;
  const Frames& frames = options.job.frames;
  if (options.json) {
    const auto name = [&](const std::string& path) {
      return frames.IsOne() ? PathOfFrame(path, frames.first()) : path;
    };
    std::vector<std::pair<std::string, std::string>> files{{"output", name(picture.output)}};
    if (!picture.noisy.empty()) files.emplace_back("noisy_output", name(picture.noisy));
    environment.out << JobJson(job, files) << "\n" << std::flush;
  }
  if (!picture.noisy.empty()) ReportLine(environment, absl::StrCat("wrote ", FilesOf(picture.noisy, frames)));
  ReportLine(environment,
             absl::StrCat("wrote ", FilesOf(picture.output, frames), " (", StageTimesText(job.times()), ")"));
}

}  // namespace

ExitCode RunRender(const std::vector<std::string>& arguments, const Environment& environment) {
  RenderOptions options;
  if (const auto ended = ParseRender(arguments, environment, &options)) return *ended;
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(options.job);
  if (!assets.ok()) return ReportError(environment, assets.status());

  if (!environment.local_farm) {
    return ReportError(environment,
                       absl::UnimplementedError("this build has no coordinator and worker; use submit"));
  }
  const absl::StatusOr<std::unique_ptr<LocalFarm>> local = environment.local_farm(options.farm);
  if (!local.ok()) return ReportError(environment, OfThisMachine(local.status()));
  const std::unique_ptr<FarmClient> farm =
      MakeFarmClient((*local)->channel(), {.coordinators = {"this process"},
                                           .time = environment.time,
                                           .interrupted = environment.interrupted,
                                           .trace_parent = environment.trace_parent});
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const absl::StatusOr<v1::JobStatus> job = RunJob(*farm, options, *assets, *progress, environment);
  if (!job.ok()) return ReportError(environment, job.status());
  if (job->state() != v1::JOB_STATE_DONE) return ReportOutcome(environment, *job);
  const absl::Status written = WritePictures(*farm, options, job->job_id(), *progress, environment);
  if (!written.ok()) return ReportError(environment, written);
  ReportRendered(options, *job, environment);
  return ExitCode::kOk;
}

}  // namespace lumifold::client
