#include "client/commands/commands.h"
#include "client/commands/shared_options.h"

namespace lumifold::client {

ExitCode RunMoveToFront(const std::vector<std::string>& arguments, const Environment& environment) {
  return RunOnJob(
      "move-to-front",
      "The job comes before all others of its user and priority, which are served in the order of "
      "their submission otherwise.",
      arguments, environment, [](FarmClient& farm, const std::string& job_id) {
        v1::SetJobPriorityRequest request;
        request.set_job_id(job_id);
        request.set_to_front(true);
        return farm.SetJobPriority(request);
      });
}

}  // namespace lumifold::client
