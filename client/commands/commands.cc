#include "client/commands/commands.h"

#include <algorithm>

#include "filter/image/check.h"

namespace lumifold::client {

const std::vector<Command>& Commands() {
  static const auto* const commands = new std::vector<Command>{
      {"render", "Render a scene on this machine and write the picture", RunRender},
      {"submit", "Hand a scene to a coordinator and print the job's id", RunSubmit},
      {"status", "Print where a job stands", RunStatus},
      {"wait", "Wait in silence until a job has ended", RunWait},
      {"watch", "Show a job's progress until it has ended", RunWatch},
      {"list", "List the coordinator's jobs, newest first", RunList},
      {"cancel", "Stop a job", RunCancel},
      {"download", "Fetch a finished frame of a job", RunDownload},
      {"filter", "Take the noise out of a picture that is already rendered", RunFilter},
      {"convert", "Show a layer of a picture as a .png", RunConvert},
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
