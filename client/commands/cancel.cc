#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunCancel(const std::vector<std::string>& arguments, const Environment& environment) {
  return RunOnJob("cancel", "A job that has ended does not change; cancelling it is not an error.", arguments,
                  environment,
                  [](FarmClient& farm, const std::string& job_id) { return farm.CancelJob(job_id); });
}

}  // namespace lumifold::client
