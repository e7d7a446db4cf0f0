#include <algorithm>

#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/job_report.h"

namespace lumifold::client {
namespace {

constexpr int kMaxJobs = 1'000'000;
constexpr int kPageJobs = 1000;  // the coordinator's limit

}  // namespace

ExitCode RunList(const std::vector<std::string>& arguments, const Environment& environment) {
  int limit = 100;
  std::vector<std::string> states;
  v1::ListJobsRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("list"));
  command_line.AddWholeNumber("--limit", &limit, 1, kMaxJobs, "Maximum number of jobs (default 100)");
  command_line.AddTexts("--state", "STATE", &states, "Only jobs in this state; may be repeated");
  command_line.AddText("--user", "NAME", request.mutable_user(), "Only jobs of this user");
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  for (const std::string& name : states) {
    const absl::StatusOr<v1::JobState> state = ParseStateName(name);
    if (!state.ok())
      return ReportUsage(environment, "lumifold list", "--state: " + std::string(state.status().message()));
    request.add_states(*state);
  }

  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  bool is_first = true;
  do {
    request.set_limit(std::min(limit, kPageJobs));
    const absl::StatusOr<v1::ListJobsResponse> page = farm->ListJobs(request);
    if (!page.ok()) return ReportError(environment, page.status());
    if (is_first && !remote.json) environment.out << JobTableHead();
    is_first = false;
    for (const v1::JobStatus& job : page->jobs())
      environment.out << (remote.json ? JobJson(job) + "\n" : JobTableLine(job));
    limit -= page->jobs_size();
    request.set_page_token(page->next_page_token());
  } while (limit > 0 && !request.page_token().empty());
  environment.out << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
