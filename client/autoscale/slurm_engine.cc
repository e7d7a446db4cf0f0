#include "client/autoscale/slurm_engine.h"

#include <set>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "client/autoscale/slurm_queue.h"
#include "proto/subprocess/run_command.h"

namespace lumifold::autoscale {
namespace {

constexpr size_t kShownBytes = 300;
/// A variable SCANCEL_STATE or the like would end other jobs than those that are named.
const std::vector<std::string> kCancelEnvironment = {"SCANCEL_*"};

class SlurmEngine final : public Engine {
 public:
  explicit SlurmEngine(SlurmOptions options) : options_(std::move(options)) {}

  absl::StatusOr<EngineState> Snapshot() override {
    // Variables of squeue would change what it prints; TZ: of the times.
    const absl::StatusOr<std::string> lines =
        Run({"squeue", "--noheader", "--me", "--states=all", kSlurmQueueFormat},
            {"TZ=UTC", "LC_ALL=C", "SLURM_TIME_FORMAT", "SQUEUE_*"});
    if (!lines.ok()) return lines.status();
    absl::StatusOr<std::vector<Request>> requests = ParseSlurmQueue(*lines, options_.farm);
    if (!requests.ok()) return requests.status();
    return EngineState{.requests = *std::move(requests)};
  }

  absl::Status Start(const EngineState& seen, int count) override {
    std::set<int> taken;
    for (const Request& request : seen.requests) {
      if (request.state != Request::State::kEnded) taken.insert(request.slot);
    }
    for (int slot = 0; count > 0; ++slot) {
      if (taken.contains(slot)) continue;
      if (absl::Status status = StartIn(slot); !status.ok()) return status;
      --count;
    }
    return absl::OkStatus();
  }

  absl::Status Release(const EngineState& seen, const std::vector<std::string>& ids) override {
    const std::set<std::string> chosen(ids.begin(), ids.end());
    // A request that is pending in `seen` and runs now is left alone: its worker may have units.
    std::vector<std::string> pending = {"scancel", "--quiet", "--state=PENDING"};
    std::vector<std::string> running = {"scancel", "--quiet"};
    const size_t options = running.size();
    for (const Request& request : seen.requests) {
      if (chosen.contains(request.id))
        (request.state == Request::State::kPending ? pending : running).push_back(request.id);
    }
    absl::Status status;
    if (pending.size() > options + 1) status.Update(Run(pending, kCancelEnvironment).status());
    if (running.size() > options) status.Update(Run(running, kCancelEnvironment).status());
    return status;
  }

 private:
  absl::Status StartIn(int slot) const {
    std::vector<std::string> command = {"sbatch", "--parsable"};
    command.insert(command.end(), options_.sbatch_arguments.begin(), options_.sbatch_arguments.end());
    command.emplace_back(absl::StrCat("--job-name=", SlurmJobName(options_.farm, slot)));
    command.emplace_back("--dependency=singleton");
    command.push_back(options_.script);
    command.insert(command.end(), options_.script_arguments.begin(), options_.script_arguments.end());
    return Run(command, {}).status();  // SBATCH_* are the user's to set
  }

  /// The output of a command that succeeds.
  absl::StatusOr<std::string> Run(const std::vector<std::string>& command,
                                  const std::vector<std::string>& environment) const {
    absl::StatusOr<subprocess::CommandResult> done =
        subprocess::RunCommand(command, environment, options_.timeout);
    if (!done.ok()) return done.status();
    if (done->exit_code == 0) return std::move(done->out);
    const std::string words = absl::StrReplaceAll(
        absl::StripAsciiWhitespace(absl::string_view(done->err).substr(0, kShownBytes)), {{"\n", "; "}});
    return absl::InternalError(absl::StrCat(command.front(), " ended with ", done->exit_code, ": ", words));
  }

  const SlurmOptions options_;
};

}  // namespace

std::unique_ptr<Engine> MakeSlurmEngine(SlurmOptions options) {
  return std::make_unique<SlurmEngine>(std::move(options));
}

}  // namespace lumifold::autoscale
