#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "client/cli/json_line.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunDelete(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("delete"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  remote.AddTo(command_line);
  command_line.SetFooter("The job must have ended: see 'lumifold cancel'. Its pictures are deleted too.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  const absl::Status status = (*farm)->DeleteJob(job_id);
  if (!status.ok()) return ReportError(environment, status);
  if (remote.json) environment.out << JsonLine({{"job_id", job_id}}) << "\n" << std::flush;
  ReportLine(environment, absl::StrCat("job ", job_id, " deleted"));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
