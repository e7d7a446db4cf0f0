#include <limits>
#include <memory>
#include <utility>

#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/preview_options.h"
#include "client/commands/shared_options.h"
#include "client/farm/follow_job.h"
#include "client/farm/job_workers.h"
#include "client/options/display_options.h"
#include "client/options/hook.h"
#include "client/reports/job_report.h"

namespace lumifold::client {
namespace {

/// The last word of a file of previews is the frame's result.
absl::Status FetchResult(FarmClient& farm, const v1::JobStatus& job, const PreviewFileOptions& file,
                         Progress& progress, Backoff backoff) {
  PictureOptions picture;
  picture.output = file.path;
  picture.display = file.display;
  picture.is_reproducible = true;  // the file as the coordinator has it
  return picture.Fetch(farm, job, file.frame, progress, std::move(backoff));
}

}  // namespace

ExitCode RunWatch(const std::vector<std::string>& arguments, const Environment& environment) {
  PreviewFileOptions file;
  Hook hook;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("watch"));
  command_line.AddArgument("JOB", &file.job_id, kJobArgumentHelp);
  AddPreview(command_line, &file.path);
  command_line.AddWholeNumber("--frame", &file.frame, 0, std::numeric_limits<int>::max(),
                              "Frame of the preview (default 0)");
  AddDisplayOptions(command_line, &file.display);
  hook.AddTo(command_line);
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The exit code is the job's outcome: 0 done, 1 failed, 5 cancelled, 6 done with gaps. Ctrl-C ends this "
      "command, not "
      "the job. At the end the file of --preview is the finished picture.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (const auto ended = CheckPreview(file.path, "lumifold watch", environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&file.job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const auto print = [&](const v1::JobStatus& job) {
    if (remote.json) environment.out << JobJson(job) << "\n" << std::flush;
  };
  const JobWorkers workers(remote.Connect(environment), file.job_id);
  ProgressWithWorkers shown(*progress, workers);
  const std::unique_ptr<PreviewFile> preview = StartPreview(remote.Connect(environment), file);
  const absl::StatusOr<v1::JobStatus> job =
      FollowJob(**farm, file.job_id, shown, remote.MakeBackoff(environment), print);
  if (!job.ok()) return ReportError(environment, job.status());
  if (preview != nullptr) {
    absl::Status written = preview->Stop();
    if (written.ok() && IsDone(*job) && !HasFrame(SkippedFrames(*job), file.frame))
      written = FetchResult(**farm, *job, file, *progress, remote.MakeBackoff(environment));
    if (!written.ok()) ReportError(environment, written);
  }
  const ExitCode outcome = ReportOutcome(environment, *job);
  return RunHook(hook, *job, file.path, outcome, environment);
}

}  // namespace lumifold::client
