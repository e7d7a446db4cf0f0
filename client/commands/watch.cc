#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/follow_job.h"
#include "client/job_report.h"

namespace lumifold::client {

ExitCode RunWatch(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  RemoteOptions remote(environment);
  CommandLine command_line("watch", SummaryOf("watch"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The exit code is the job's outcome: 0 done, 1 failed, 5 cancelled. Ctrl-C ends this command, not "
      "the job.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  const auto print = [&](const v1::JobStatus& job) {
    if (remote.json) environment.out << JobJson(job) << "\n" << std::flush;
  };
  const absl::StatusOr<v1::JobStatus> job =
      FollowJob(*farm, job_id, *progress, MakeBackoff(environment), print);
  if (!job.ok()) return ReportError(environment, job.status());
  return ReportOutcome(environment, *job);
}

}  // namespace lumifold::client
