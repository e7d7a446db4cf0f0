#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/farm_report.h"

namespace lumifold::client {

ExitCode RunExplain(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("explain"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  const absl::StatusOr<v1::ExplainJobResponse> answer = (*farm)->ExplainJob(job_id);
  if (!answer.ok()) return ReportError(environment, answer.status());
  environment.out << (remote.json ? ExplanationJson(*answer) + "\n" : ExplanationText(*answer)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
