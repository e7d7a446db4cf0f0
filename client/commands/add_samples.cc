#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/options/job_options.h"

namespace lumifold::client {

ExitCode RunAddSamples(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string job_id;
  int samples = 0;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("add-samples"));
  command_line.AddArgument("JOB", &job_id, kJobArgumentHelp);
  command_line.AddWholeNumberArgument("SAMPLES", &samples, 1, kMaxSamples, "Samples per pixel in total");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The picture is that of a job submitted with as many samples. A job that has ended runs again.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  const absl::StatusOr<std::unique_ptr<FarmClient>> farm = remote.ConnectFor(&job_id, environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  return ReportJob(environment, remote.json, (*farm)->AddSamples(job_id, samples));
}

}  // namespace lumifold::client
