#include "client/commands/run_client.h"

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/command_line.h"
#include "client/cli/option_file.h"
#include "client/cli/suggestion.h"
#include "client/commands/commands.h"
#include "proto/rpc/version.h"

namespace lumifold::client {
namespace {

std::string Help() {
  std::string text =
      "Lumifold renders glTF scenes, on this machine or on a farm, and filters only their noise.\n"
      "\n"
      "Usage: lumifold COMMAND [OPTIONS]\n"
      "       lumifold help COMMAND\n"
      "       lumifold --version\n"
      "\n"
      "Commands:\n";
  for (const Command& command : Commands())
    absl::StrAppendFormat(&text, "  %-13s %s\n", command.name, command.summary);
  absl::StrAppend(&text, "\nData goes to standard output, messages and progress to standard error.\n",
                  kExitCodesHelp, "\n");
  return text;
}

/// As in files.
std::vector<std::string> OptionNames(const Environment& environment) {
  std::set<std::string> names;
  for (const CommandHelp& command : DescribeCommands(environment)) {
    for (const OptionHelp& option : command.options) {
      if (option.is_argument()) names.insert(absl::AsciiStrToLower(option.value_name));
      for (const std::string& name : option.names) {
        if (name.starts_with("--")) names.insert(name.substr(2));
      }
    }
  }
  return {names.begin(), names.end()};
}

ExitCode Run(const Command& command, const std::vector<std::string>& arguments, Environment environment) {
  environment.configuration.known_options = OptionNames(environment);
  std::error_code ignored;
  OptionFile configuration;
  if (std::filesystem::exists(environment.configuration.path, ignored)) {
    absl::StatusOr<OptionFile> read = ReadConfiguration(environment);
    if (read.ok()) {
      configuration = *std::move(read);
      environment.configuration.file = &configuration;
    } else if (!command.is_without_configuration) {
      ReportError(environment, read.status());
      return ExitCode::kUsage;
    }
  }
  return command.run(arguments, environment);
}

bool IsHelp(const std::string& word) { return word == "--help" || word == "-h" || word == "help"; }

ExitCode Dispatch(const std::vector<std::string>& arguments, const Environment& environment) {
  if (arguments.empty()) {
    environment.err << Help() << std::flush;
    return ExitCode::kUsage;
  }
  const std::string& name = arguments.front();
  if (IsHelp(name) && arguments.size() > 1 && !IsHelp(arguments[1]))
    return Dispatch({arguments[1], "--help"}, environment);
  if (IsHelp(name)) {
    environment.out << Help() << std::flush;
    return ExitCode::kOk;
  }
  if (name == "--version") {
    environment.out << "lumifold " << rpc::kVersion << "\n" << std::flush;
    return ExitCode::kOk;
  }
  std::vector<std::string> names = {"--help", "--version"};
  for (const Command& command : Commands()) {
    if (command.name == name) return Run(command, {arguments.begin() + 1, arguments.end()}, environment);
    names.push_back(command.name);
  }
  const char* kind = name.starts_with("-") ? "unknown option " : "unknown command ";
  return ReportUsage(environment, "lumifold", absl::StrCat(kind, "'", name, "'", Suggestion(name, names)));
}

}  // namespace

int RunClient(int argc, const char* const* argv, const Environment& environment) {
  const std::vector<std::string> arguments(argv + std::min(argc, 1), argv + argc);
  return static_cast<int>(Dispatch(arguments, environment));
}

}  // namespace lumifold::client
