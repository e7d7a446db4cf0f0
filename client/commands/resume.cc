#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunResume(const std::vector<std::string>& arguments, const Environment& environment) {
  return RunOnJob("resume", "A job that is not paused does not change; resuming it is not an error.",
                  arguments, environment, [](FarmClient& farm, const std::string& job_id) {
                    return farm.SetJobPaused(job_id, false);
                  });
}

}  // namespace lumifold::client
