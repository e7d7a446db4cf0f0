#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/shared_options.h"
#include "client/follow_job.h"
#include "client/job_report.h"
#include "client/job_workers.h"
#include "client/output_file.h"
#include "client/preview_file.h"

namespace lumifold::client {
namespace {

/// The last word of a file of previews is the frame's result.
absl::Status FetchResult(FarmClient& farm, const PreviewFileOptions& file, Progress& progress,
                         Backoff backoff) {
  PictureOptions picture;
  picture.output = file.path;
  picture.exposure = file.exposure;
  return picture.Fetch(farm, file.job_id, file.frame, progress, std::move(backoff));
}

}  // namespace

ExitCode RunWatch(const std::vector<std::string>& arguments, const Environment& environment) {
  PreviewFileOptions file;
  RemoteOptions remote(environment);
  CommandLine command_line("watch", SummaryOf("watch"));
  command_line.AddArgument("JOB", &file.job_id, kJobArgumentHelp);
  command_line.AddText("--preview", "FILE", &file.path,
                       "Keep this .png or .exr up to date with a small filtered picture of what is rendered");
  command_line.AddWholeNumber("--frame", &file.frame, 0, std::numeric_limits<int>::max(),
                              "Frame of the preview (default 0)");
  command_line.AddPositiveNumber("--exposure", &file.exposure,
                                 "Factor on the radiance of a .png (default 1)");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The exit code is the job's outcome: 0 done, 1 failed, 5 cancelled. Ctrl-C ends this command, not "
      "the job. At the end the file of --preview is the finished picture.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (!file.path.empty()) {
    const absl::StatusOr<PictureFormat> format = PictureFormatOf(file.path);
    if (!format.ok())
      return ReportUsage(environment, "lumifold watch",
                         absl::StrCat("--preview: ", format.status().message()));
    if (const absl::Status writable = CheckOutput(file.path); !writable.ok())
      return ReportError(environment, writable);
  }

  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const auto print = [&](const v1::JobStatus& job) {
    if (remote.json) environment.out << JobJson(job) << "\n" << std::flush;
  };
  const JobWorkers workers(remote.Connect(environment), file.job_id);
  ProgressWithWorkers shown(*progress, workers);
  std::unique_ptr<PreviewFile> preview;
  if (!file.path.empty()) preview = std::make_unique<PreviewFile>(remote.Connect(environment), file);
  const absl::StatusOr<v1::JobStatus> job =
      FollowJob(*farm, file.job_id, shown, MakeBackoff(environment), print);
  if (!job.ok()) return ReportError(environment, job.status());
  if (preview != nullptr) {
    absl::Status written = preview->Stop();
    if (written.ok() && job->state() == v1::JOB_STATE_DONE)
      written = FetchResult(*farm, file, *progress, MakeBackoff(environment));
    if (!written.ok()) ReportError(environment, written);
  }
  return ReportOutcome(environment, *job);
}

}  // namespace lumifold::client
