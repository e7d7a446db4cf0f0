#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunPause(const std::vector<std::string>& arguments, const Environment& environment) {
  return RunOnJob(
      "pause", "Units that are being rendered are still accepted. The job stays paused until it is resumed.",
      arguments, environment,
      [](FarmClient& farm, const std::string& job_id) { return farm.SetJobPaused(job_id, true); });
}

}  // namespace lumifold::client
