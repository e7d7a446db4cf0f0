#include "client/commands/commands.h"

#include <algorithm>

#include "filter/image/check.h"

namespace lumifold::client {

const std::vector<Command>& Commands() {
  static const auto* const commands = new std::vector<Command>{
      {"render", "Render a scene on this machine and write the picture", RunRender},
      {"submit", "Submit a scene to a coordinator and print the job's id", RunSubmit},
      {"status", "Print the status of a job", RunStatus},
      {"wait", "Wait until a job has ended, without showing progress", RunWait},
      {"watch", "Show a job's progress until it has ended", RunWatch},
      {"list", "List the coordinator's jobs, newest first", RunList},
      {"cancel", "Stop a job", RunCancel},
      {"download", "Download a finished frame of a job", RunDownload},
      {"filter", "Filter the noise of a picture that is already rendered", RunFilter},
      {"convert", "Write a layer of a picture as .png", RunConvert},
      {"compare", "Print the error of one picture against another", RunCompare},
  };
  return *commands;
}

const std::string& SummaryOf(const std::string& name) {
  const auto command = std::find_if(Commands().begin(), Commands().end(),
                                    [&](const Command& candidate) { return candidate.name == name; });
  LUMIFOLD_CHECK(command != Commands().end());
  return command->summary;
}

}  // namespace lumifold::client
