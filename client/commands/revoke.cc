#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunRevoke(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::RevokeRequest request;
  std::string name;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("revoke"));
  command_line.AddOptionalArgument("NAME", &name, "All of this person or worker");
  command_line.AddText("--id", "ID", request.mutable_id(), "Only this token, certificate or invite");
  remote.AddTo(command_line);
  command_line.SetFooter("What runs with it ends within seconds. Its owner needs a new invite.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (name.empty() == request.id().empty())
    return ReportUsage(environment, "lumifold revoke", "expected either NAME or --id");
  request.set_name(name);

  const absl::StatusOr<v1::RevokeResponse> response = remote.ConnectToAccess(environment)->Revoke(request);
  if (!response.ok()) return ReportError(environment, response.status());
  ReportLine(environment, absl::StrCat("revoked: ", response->revoked()));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
