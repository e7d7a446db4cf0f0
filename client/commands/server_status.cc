#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/farm_report.h"

namespace lumifold::client {

ExitCode RunServerStatus(const std::vector<std::string>& arguments, const Environment& environment) {
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("server-status"));
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<v1::ServerStatus> status = remote.Connect(environment)->GetServerStatus();
  if (!status.ok()) return ReportError(environment, status.status());
  environment.out << (remote.json ? ServerStatusJson(*status) + "\n" : ServerStatusText(*status))
                  << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
