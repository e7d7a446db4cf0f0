#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunDrain(const std::vector<std::string>& arguments, const Environment& environment) {
  v1::WorkerRequest request;
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("drain"));
  command_line.AddArgument("WORKER", request.mutable_worker(), kWorkerArgumentHelp);
  bool finish_units = false;
  command_line.AddFlag("--after-units", &finish_units,
                       "Let it finish the units that it is rendering, however long they take");
  remote.AddTo(command_line);
  command_line.SetFooter("The worker takes no more units, finishes or hands back those it has, and ends.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  request.set_finish_units(finish_units);
  return ReportWorker(environment, remote.json, remote.Connect(environment)->DrainWorker(request));
}

}  // namespace lumifold::client
