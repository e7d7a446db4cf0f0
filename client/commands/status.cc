#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/job_report.h"

namespace lumifold::client {

ExitCode RunStatus(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("status"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  const absl::StatusOr<v1::JobStatus> job = (*farm)->GetJob(job_id);
  if (!job.ok()) return ReportError(environment, job.status());
  environment.out << (remote.json ? JobJson(*job) + "\n" : JobText(*job)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
