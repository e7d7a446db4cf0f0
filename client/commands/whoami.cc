#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/access_report.h"

namespace lumifold::client {

ExitCode RunWhoAmI(const std::vector<std::string>& arguments, const Environment& environment) {
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("whoami"));
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::StatusOr<v1::WhoAmIResponse> caller = remote.ConnectToAccess(environment)->WhoAmI();
  if (!caller.ok()) return ReportError(environment, caller.status());
  environment.out << (remote.json ? WhoAmIJson(*caller) + "\n" : WhoAmIText(*caller)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
