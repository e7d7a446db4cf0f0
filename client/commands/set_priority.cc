#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/scheduling_options.h"

namespace lumifold::client {

ExitCode RunSetPriority(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  int priority = 0;
  RemoteOptions remote(environment);
  CommandLine command_line("set-priority", SummaryOf("set-priority"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  command_line.AddWholeNumberArgument("PRIORITY", &priority, kMinPriority, kMaxPriority,
                                      "-100 to 100; ten more doubles the job's share");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  v1::SetJobPriorityRequest request;
  request.set_job_id(job_id);
  request.set_priority(priority);
  return ReportJob(environment, remote.json, remote.Connect(environment)->SetJobPriority(request));
}

}  // namespace lumifold::client
