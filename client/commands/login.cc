#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "proto/identity/join.h"
#include "proto/identity/secrets.h"

namespace lumifold::client {

ExitCode RunLogin(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string server;
  std::string code;
  std::string profile = identity::kDefaultProfile;
  bool certificate = false;
  CommandLine command_line(WordsOf("login"));
  command_line.AddArgument("SERVER", &server,
                           "HOST:PORT of the coordinator, or those of one farm, as for --server");
  command_line.AddOptionalArgument(
      "CODE", &code, "From 'lumifold invite'; without it, or with '-', it is read from standard input");
  command_line.AddText("--profile", "NAME", &profile,
                       "Where to keep the token or certificate (default: default)");
  command_line.AddFlag("--certificate", &certificate,
                       "Get a certificate, whose key never leaves this machine, instead of a token");
  command_line.SetFooter(
      "Both are kept in ~/.config/lumifold, or in $XDG_CONFIG_HOME/lumifold, for you alone.\n"
      "A certificate is renewed by the commands that use it, in the last third of its life.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  identity::ProtectMemory();
  const absl::StatusOr<std::string> text = identity::ReadCode(
      code, environment.in, environment.terminal.err_is_terminal ? &environment.err : nullptr);
  if (!text.ok()) return ReportError(environment, text.status());
  const absl::StatusOr<v1::LoginResponse> login =
      identity::Login(identity::Profiles(environment.profiles_folder), profile, server, *text,
                      certificate ? identity::LoginForm::kCertificate : identity::LoginForm::kToken);
  if (!login.ok()) return ReportError(environment, login.status());
  ReportLine(environment,
             absl::StrCat("logged in to ", server, " as ", login->name(), "; profile '", profile, "'"));
  return ExitCode::kOk;
}

}  // namespace lumifold::client
