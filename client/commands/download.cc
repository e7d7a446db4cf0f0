#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/shared_options.h"
#include "client/reports/job_report.h"
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
  CommandLine command_line(WordsOf("download"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  command_line.AddFrames("--frame,--frames", &frames, "Frames, such as 7, 1-48 or 1-48,60 (default 0)");
  picture.AddTo(command_line, "-o,--output", /*is_required=*/true);
  remote.AddTo(command_line);
  command_line.SetFooter("An interrupted download is kept beside FILE; the same command resumes it.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (const auto ended = picture.Check(frames, "lumifold download", environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const absl::StatusOr<v1::JobStatus> job = (*farm)->GetJob(job_id);
  if (!job.ok()) return ReportError(environment, job.status());
  const std::vector<FrameRange> skipped = SkippedFrames(*job);
  std::vector<FrameRange> missing;
  for (const FrameRange& range : frames.ranges) {
    for (int frame = range.first; frame <= range.last; ++frame) {
      if (HasFrame(skipped, frame)) {
        AddFrame(frame, &missing);
        continue;
      }
      const absl::Status downloaded =
          picture.Fetch(**farm, *job, frame, *progress, remote.MakeBackoff(environment));
      if (!downloaded.ok()) return ReportError(environment, downloaded);
      ReportDownloaded(job_id, frame, picture.OutputOf(*job, frame), remote.json, environment);
    }
  }
  if (missing.empty()) return ExitCode::kOk;
  ReportLine(environment, absl::StrCat("job ", job_id, " has no picture of the frames ", TextOf(missing),
                                       ": they are skipped"));
  return ExitCode::kGaps;
}

}  // namespace lumifold::client
