#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/farm/find_job.h"
#include "client/reports/farm_report.h"

namespace lumifold::client {
namespace {

constexpr int kMaxEvents = 1000;
constexpr char kJobPrefix[] = "j-";

}  // namespace

ExitCode RunLogs(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string subject;
  int limit = 100;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("logs"));
  command_line.AddArgument("JOB|WORKER", &subject,
                           "A job by its id (j-...) or 'last', or a worker's id (w-...) or name");
  command_line.AddWholeNumber("--limit", &limit, 1, kMaxEvents, "Maximum number of events (default 100)");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The coordinator keeps the last events of all jobs and workers in memory only, and those that workers "
      "have\n"
      "sent with failures and heartbeats: lines that begin with the worker are of its own log.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const bool is_job = subject.starts_with(kJobPrefix) || subject == kLastJob;
  const absl::StatusOr<std::unique_ptr<FarmClient>> farm =
      is_job ? remote.ConnectFor(&subject, environment) : remote.Connect(environment);
  if (!farm.ok()) return ReportError(environment, farm.status());
  v1::GetLogRequest request;
  (is_job ? *request.mutable_job_id() : *request.mutable_worker()) = subject;
  request.set_limit(limit);
  const absl::StatusOr<v1::GetLogResponse> log = (*farm)->GetLog(request);
  if (!log.ok()) return ReportError(environment, log.status());
  for (const v1::LogEvent& event : log->events())
    environment.out << (remote.json ? LogEventJson(event) + "\n" : LogEventLine(event));
  environment.out << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
