// What the autoscaler reads: the output of squeue, and its own state. The first byte of an input chooses.

#include <set>

#include "client/autoscale/policy/policy.h"
#include "client/autoscale/slurm_queue.h"
#include "client/autoscale/state_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace lumifold::fuzz {
namespace {

using autoscale::EngineState;
using autoscale::Request;

/// Whatever an engine says, the limits hold.
void Decide(std::vector<Request> requests) {
  const EngineState engine{.requests = std::move(requests)};
  const autoscale::Limits limits{.minimum = 1, .maximum = 5, .budget_core_hours = 100};
  autoscale::History history;
  const absl::Time now = absl::UnixEpoch() + absl::Hours(500'000);
  const autoscale::Decision decision =
      autoscale::Decide(now, {.users = {{.queued = 1'000'000}}}, engine, limits, {}, &history);
  const int active = decision.pending + decision.running;
  if (decision.start < 0 || (decision.start > 0 && active + decision.start > limits.maximum))
    Fail("too many starts", decision.reason);
  if (!autoscale::ParseHistory(autoscale::HistoryJson(history)).ok())
    Fail("a history that cannot be read again", autoscale::HistoryJson(history));
}

void TrySlurm(std::string_view text) {
  auto requests = autoscale::ParseSlurmQueue(std::string(text), "f");
  if (!requests.ok()) return;
  std::set<int> slots;
  for (const Request& request : *requests) {
    if (request.state != Request::State::kEnded && !request.duplicate && !slots.insert(request.slot).second)
      Fail("two requests of a slot", std::string(text));
  }
  Decide(*std::move(requests));
}

}  // namespace

std::vector<std::string> Seeds() {
  autoscale::History history;
  history.counted_ends = {"1/2"};
  history.charges["3/4"].cores = 2;
  std::vector<std::string> seeds;
  seeds.emplace_back(
      "\001"
      "12|RUNNING|2026-03-01T10:00:00|2026-03-01T14:00:00|8|None|lumifold-f-0\n"
      "13|PENDING|N/A|N/A|8|Dependency|lumifold-f-0\n"
      "14|COMPLETED|2026-03-01T10:00:00|2026-03-01T10:00:05|1|None|lumifold-f-1\n");
  seeds.push_back(std::string("\002").append(autoscale::HistoryJson(history)));
  return seeds;
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace lumifold;
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] % 2 == 1) {
    fuzz::TrySlurm(text);
  } else if (const auto history = autoscale::ParseHistory(std::string(text)); history.ok()) {
    static_cast<void>(autoscale::HistoryJson(*history));
  }
  return 0;
}
