#include <algorithm>

#include "absl/strings/str_cat.h"
#include "client/cli/command_line.h"
#include "client/cli/man_page.h"
#include "client/commands/commands.h"

namespace lumifold::client {

ExitCode RunMan(const std::vector<std::string>& arguments, const Environment& environment) {
  std::string name;
  CommandLine command_line(WordsOf("man"));
  command_line.AddOptionalArgument("COMMAND", &name,
                                   "A command of lumifold; without it, the page that lists them");
  command_line.SetFooter("lumifold man render | man -l -");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;

  const std::vector<CommandHelp> commands = DescribeCommands(environment);
  if (name.empty()) {
    environment.out << ManPage(commands) << std::flush;
    return ExitCode::kOk;
  }
  const auto command = std::find_if(commands.begin(), commands.end(),
                                    [&name](const CommandHelp& candidate) { return candidate.name == name; });
  if (command == commands.end())
    return ReportUsage(environment, "lumifold man", absl::StrCat("there is no command '", name, "'"));
  environment.out << ManPage(*command) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
