#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/shared_options.h"
#include "client/pictures/output_template.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::client {
namespace {

void ReportDownloaded(const std::string& job_id, int frame, const std::string& path, bool as_json,
                      const Environment& environment) {
  if (as_json) {
    nlohmann::ordered_json json{{"job_id", job_id}, {"frame", frame}, {"output", path}};
    if (const std::string trace_id = rpc::TraceIdOf(environment.trace_parent); !trace_id.empty())
      json["trace_id"] = trace_id;
    environment.out << JsonLine(json) << "\n" << std::flush;
  }
  ReportLine(environment, absl::StrCat("wrote ", path));
}

}  // namespace

ExitCode RunDownload(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  Frames frames;
  PictureOptions picture;
  picture.threads = environment.defaults.threads;
  RemoteOptions remote(environment);
  CommandLine command_line("download", SummaryOf("download"));
  command_line.AddArgument("JOB", &job_id, "The job's id, as submit printed it");
  command_line.AddFrames("--frame,--frames", &frames, "Frames, such as 7, 1-48 or 1-48,60 (default 0)");
  picture.AddTo(command_line, "-o,--output", /*is_required=*/true);
  remote.AddTo(command_line);
  command_line.SetFooter("An interrupted download is kept beside FILE; the same command resumes it.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (const auto ended = picture.Check(frames, "lumifold download", environment)) return *ended;

  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  v1::JobStatus job;
  job.set_job_id(job_id);
  if (!picture.is_reproducible || NeedsJob(picture.output) || NeedsJob(picture.noisy)) {
    absl::StatusOr<v1::JobStatus> known = farm->GetJob(job_id);
    if (!known.ok()) return ReportError(environment, known.status());
    job = *std::move(known);
  }
  for (const FrameRange& range : frames.ranges) {
    for (int frame = range.first; frame <= range.last; ++frame) {
      const absl::Status downloaded =
          picture.Fetch(*farm, job, frame, *progress, remote.MakeBackoff(environment));
      if (!downloaded.ok()) return ReportError(environment, downloaded);
      ReportDownloaded(job_id, frame, picture.OutputOf(job, frame), remote.json, environment);
    }
  }
  return ExitCode::kOk;
}

}  // namespace lumifold::client
