#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/command_help.h"
#include "client/cli/environment.h"
#include "client/cli/option_file.h"

namespace lumifold::client {

/// One subcommand. `run` takes the arguments after its name.
struct Command : CommandWords {
  ExitCode (*run)(const std::vector<std::string>& arguments, const Environment& environment);
  /// It runs although the configuration cannot be read.
  bool is_without_configuration = false;
};

/// All subcommands in the order help lists them.
const std::vector<Command>& Commands();

/// The help of all of them, as they describe themselves.
std::vector<CommandHelp> DescribeCommands(const Environment& environment);

/// The user's configuration, environment.configuration.path, with names that are among the known ones.
/// Errors: those of ReadOptionFile and CheckNames.
absl::StatusOr<OptionFile> ReadConfiguration(const Environment& environment);

/// The words of a command in Commands().
const CommandWords& WordsOf(const std::string& name);

// One file each: render.cc, submit.cc, ...
ExitCode RunRender(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunPlan(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunSubmit(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunStatus(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunWait(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunPage(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunWatch(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunList(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunCancel(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunDelete(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunExplain(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunLogs(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunPause(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunResume(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunMoveToFront(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunSetPriority(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunAddSamples(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunRetry(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunWorkers(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunDrain(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunBlock(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunReadmit(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunUsage(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunServerStatus(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunDownload(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunLogin(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunLogout(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunWhoAmI(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunInvite(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunIdentities(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunRevoke(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunFilter(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunConvert(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunCompare(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunInfo(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunDoctor(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunSchema(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunCompletion(const std::vector<std::string>& arguments, const Environment& environment);
ExitCode RunMan(const std::vector<std::string>& arguments, const Environment& environment);

}  // namespace lumifold::client
