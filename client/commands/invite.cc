#include <algorithm>

#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/access_report.h"

namespace lumifold::client {
namespace {

constexpr double kSecondsPerHour = 3600;

}  // namespace

ExitCode RunInvite(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::CreateInviteRequest request;
  bool is_worker = false;
  float hours = 0;
  std::vector<std::string> scopes;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("invite"));
  command_line.AddArgument("NAME", request.mutable_name(), "Of the person or worker");
  command_line.AddFlag("--worker", &is_worker, "Invite a worker, not a person");
  command_line.AddTexts("--scope", "SCOPE", &scopes,
                        "read, submit or admin; may be repeated (default: read,submit)");
  command_line.AddPositiveNumber(
      "--hours", &hours,
      "Lifetime of a person's token (default: 90 days) or of all its certificates (default: no end)");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "Prints a code that is valid once and for 24 hours, for 'lumifold login' or 'lumifold-worker enroll'.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (is_worker && !scopes.empty())
    return ReportUsage(environment, "lumifold invite", "--scope: a worker has none");
  request.set_kind(is_worker ? v1::HOLDER_KIND_WORKER : v1::HOLDER_KIND_PERSON);
  if (!is_worker) {
    if (scopes.empty()) scopes = {"read", "submit"};
    if (hours > 0) {
      request.set_token_lifetime_seconds(
          std::max(int64_t{1}, static_cast<int64_t>(static_cast<double>(hours) * kSecondsPerHour)));
    }
  }
  for (const std::string& name : scopes) {
    const absl::StatusOr<v1::AccessScope> scope = ParseScope(name);
    if (!scope.ok())
      return ReportUsage(environment, "lumifold invite", absl::StrCat("--scope: ", scope.status().message()));
    request.add_scopes(*scope);
  }

  const absl::StatusOr<v1::CreateInviteResponse> invite =
      remote.ConnectToAccess(environment)->CreateInvite(request);
  if (!invite.ok()) return ReportError(environment, invite.status());
  environment.out << (remote.json ? InviteJson(*invite) : invite->code()) << "\n" << std::flush;
  const std::string command = is_worker ? "lumifold-worker enroll " : "lumifold login ";
  ReportLine(environment, absl::StrCat("for ", request.name(), ": ", command, remote.server, " CODE"));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
