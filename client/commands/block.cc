#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunBlock(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::WorkerRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("block"));
  command_line.AddArgument("WORKER", request.mutable_worker(), kWorkerArgumentHelp);
  command_line.AddText("--reason", "TEXT", request.mutable_reason(), "Why, for 'lumifold workers'");
  remote.AddTo(command_line);
  command_line.SetFooter(
      "The worker's units are rendered by others. The block holds for its name until it is readmitted.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  return ReportWorker(environment, remote.json, remote.Connect(environment)->BlockWorker(request));
}

}  // namespace lumifold::client
