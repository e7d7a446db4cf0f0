#include <algorithm>
#include <array>

#include "client/cli/command_line.h"
#include "client/commands/commands.h"
#include "client/options/job_schema.h"

namespace lumifold::client {

ExitCode RunSchema(const std::vector<std::string>& arguments, const Environment& environment) {
  CommandLine command_line(WordsOf("schema"));
  command_line.SetFooter("Editors complete and check a job file by it.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  constexpr std::array<absl::string_view, 3> kCommandsOfJobs = {"submit", "render", "plan"};
  std::vector<CommandHelp> commands;
  for (CommandHelp& command : DescribeCommands(environment)) {
    if (std::find(kCommandsOfJobs.begin(), kCommandsOfJobs.end(), command.name) != kCommandsOfJobs.end())
      commands.push_back(std::move(command));
  }
  environment.out << JobSchema(commands) << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
