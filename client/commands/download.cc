#include "client/download.h"

#include <limits>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/picture_options.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunDownload(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  int frame = 0;
  PictureOptions picture;
  RemoteOptions remote(environment);
  CommandLine command_line("download", SummaryOf("download"));
  command_line.AddArgument("JOB", &job_id, "The job's id, as submit printed it");
  command_line.AddWholeNumber("--frame", &frame, 0, std::numeric_limits<int>::max() - 1,
                              "Number of the frame (default 0)");
  picture.AddTo(command_line);
  remote.AddTo(command_line);
  command_line.SetFooter(
      "What an interrupted download has fetched is kept beside FILE; the same command goes on from there.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (const auto ended = picture.Check("lumifold download", environment)) return *ended;

  const absl::StatusOr<std::string> part = PartPath(picture.output, job_id, frame);
  if (!part.ok()) return ReportError(environment, part.status());
  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  absl::Status status = DownloadFrame(*farm, job_id, frame, *part, *progress, MakeBackoff(environment));
  if (status.ok()) status = picture.Write(*part);
  if (!status.ok()) return ReportError(environment, status);
  if (remote.json) {
    const nlohmann::ordered_json json{{"job_id", job_id}, {"frame", frame}, {"output", picture.output}};
    environment.out << json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << "\n"
                    << std::flush;
  }
  ReportLine(environment, absl::StrCat("wrote ", picture.output));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
