#include "client/commands/run_client.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/command_line.h"
#include "client/commands/commands.h"
#include "client/suggestion.h"
#include "proto/rpc/version.h"

namespace lumifold::client {
namespace {

std::string Help() {
  std::string text =
      "Lumifold renders glTF scenes, on this machine or on a farm, and filters only their noise.\n"
      "\n"
      "Usage: lumifold COMMAND [OPTIONS]\n"
      "       lumifold COMMAND --help\n"
      "       lumifold --version\n"
      "\n"
      "Commands:\n";
  for (const Command& command : Commands())
    absl::StrAppendFormat(&text, "  %-13s %s\n", command.name, command.summary);
  absl::StrAppend(&text, "\nData goes to standard output, messages and progress to standard error.\n",
                  kExitCodesHelp, "\n");
  return text;
}

ExitCode Dispatch(const std::vector<std::string>& arguments, const Environment& environment) {
  if (arguments.empty()) {
    environment.err << Help() << std::flush;
    return ExitCode::kUsage;
  }
  const std::string& name = arguments.front();
  if (name == "--help" || name == "-h" || name == "help") {
    environment.out << Help() << std::flush;
    return ExitCode::kOk;
  }
  if (name == "--version") {
    environment.out << "lumifold " << rpc::kVersion << "\n" << std::flush;
    return ExitCode::kOk;
  }
  std::vector<std::string> names = {"--help", "--version"};
  for (const Command& command : Commands()) {
    if (command.name == name) return command.run({arguments.begin() + 1, arguments.end()}, environment);
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
