#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunLogout(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string profile = identity::kDefaultProfile;
  CommandLine command_line(WordsOf("logout"));
  command_line.AddText("--profile", "NAME", &profile, "The profile (default: default)");
  command_line.SetFooter(
      "The token or certificate itself stays valid until it expires or an administrator revokes it.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const absl::Status status = identity::Profiles(environment.profiles_folder).Remove(profile);
  if (absl::IsNotFound(status)) return ReportError(environment, status);
  if (!status.ok()) return ReportError(environment, OfThisMachine(status));
  ReportLine(environment, absl::StrCat("removed the profile '", profile, "'"));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
