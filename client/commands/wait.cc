#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/farm/follow_job.h"
#include "client/options/hook.h"
#include "client/reports/job_report.h"

namespace lumifold::client {

ExitCode RunWait(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  Hook hook;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("wait"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  hook.AddTo(command_line);
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The exit code is the job's outcome: 0 done, 1 failed, 5 cancelled, 6 done with gaps.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  QuietProgress progress(environment.err);
  const absl::StatusOr<v1::JobStatus> job =
      FollowJob(**farm, job_id, progress, remote.MakeBackoff(environment), [](const v1::JobStatus&) {});
  if (!job.ok()) return ReportError(environment, job.status());
  environment.out << (remote.json ? JobJson(*job) : std::string(StateName(job->state()))) << "\n"
                  << std::flush;
  const ExitCode outcome = job->error().empty() ? ExitCodeForOutcome(*job) : ReportOutcome(environment, *job);
  return RunHook(hook, *job, "", outcome, environment);
}

}  // namespace lumifold::client
