#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/job_report.h"

namespace lumifold::client {

ExitCode RunCancel(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line("cancel", SummaryOf("cancel"));
  command_line.AddArgument("JOB", &job_id, "The job's id, as submit printed it");
  remote.AddTo(command_line);
  command_line.SetFooter("A job that has ended does not change; cancelling it is not an error.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<v1::JobStatus> job = remote.Connect(environment)->CancelJob(job_id);
  if (!job.ok()) return ReportError(environment, job.status());
  if (remote.json) environment.out << JobJson(*job) << "\n" << std::flush;
  ReportOutcome(environment, *job);
  return ExitCode::kOk;
}

}  // namespace lumifold::client
