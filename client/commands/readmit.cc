#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunReadmit(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::WorkerRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("readmit"));
  command_line.AddArgument("WORKER", request.mutable_worker(), kWorkerArgumentHelp);
  remote.AddTo(command_line);
  command_line.SetFooter("Ends a block, or the time for which the worker was set aside.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  return ReportWorker(environment, remote.json, remote.Connect(environment)->ReadmitWorker(request));
}

}  // namespace lumifold::client
