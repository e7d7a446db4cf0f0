#include "absl/strings/str_cat.h"
#include "client/cli/command_line.h"
#include "client/cli/completion_script.h"
#include "client/commands/commands.h"

namespace lumifold::client {

ExitCode RunCompletion(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string shell;
  CommandLine command_line("completion", SummaryOf("completion"));
  command_line.AddArgument("SHELL", &shell, "bash, zsh or fish");
  command_line.SetFooter("For bash: source <(lumifold completion bash)");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const auto script = shell == "bash"   ? BashCompletion
                      : shell == "zsh"  ? ZshCompletion
                      : shell == "fish" ? FishCompletion
                                        : nullptr;
  if (script == nullptr)
    return ReportUsage(environment, "lumifold completion",
                       absl::StrCat("SHELL: expected bash, zsh or fish; got '", shell, "'"));
  environment.out << script(DescribeCommands(environment)) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
