#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/cli/command_line.h"
#include "client/cli/completion_script.h"
#include "client/commands/commands.h"

namespace lumifold::client {

ExitCode RunCompletion(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string shell;
  CommandLine command_line(WordsOf("completion"));
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
  std::vector<CommandHelp> commands = DescribeCommands(environment);
  const std::vector<std::string> methods =
      absl::StrSplit(absl::StrReplaceAll(environment.local.methods.names, {{" and ", ", "}}), ", ");
  for (CommandHelp& command : commands) {
    for (OptionHelp& option : command.options) {
      if (option.value_name == "METHOD") option.choices = methods;
    }
  }
  environment.out << script(commands) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
