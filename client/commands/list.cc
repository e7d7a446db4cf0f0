#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/job_report.h"

namespace lumifold::client {
namespace {

constexpr int kMaxJobs = 10000;

}  // namespace

ExitCode RunList(const std::vector<std::string>& arguments, const Environment& environment) {
  int limit = 100;
  RemoteOptions remote(environment);
  CommandLine command_line("list", SummaryOf("list"));
  command_line.AddWholeNumber("--limit", &limit, 1, kMaxJobs, "Maximum number of jobs (default 100)");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<std::vector<v1::JobStatus>> jobs = remote.Connect(environment)->ListJobs(limit);
  if (!jobs.ok()) return ReportError(environment, jobs.status());
  if (!remote.json) environment.out << JobTableHead();
  for (const v1::JobStatus& job : *jobs)
    environment.out << (remote.json ? JobJson(job) + "\n" : JobTableLine(job));
  environment.out << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
