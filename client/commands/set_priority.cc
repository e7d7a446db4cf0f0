#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/scheduling_options.h"

namespace lumifold::client {

ExitCode RunSetPriority(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::SetJobPriorityRequest request;
  int priority = 0;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("set-priority"));
  command_line.AddArgument("JOB", request.mutable_job_id(), kJobArgumentHelp);
  command_line.AddWholeNumberArgument("PRIORITY", &priority, kMinPriority, kMaxPriority,
                                      "-100 to 100; ten more doubles the job's share");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  const absl::StatusOr<std::unique_ptr<FarmClient>> farm =
      remote.ConnectFor(request.mutable_job_id(), environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  request.set_priority(priority);
  return ReportJob(environment, remote.json, (*farm)->SetJobPriority(request));
}

}  // namespace lumifold::client
