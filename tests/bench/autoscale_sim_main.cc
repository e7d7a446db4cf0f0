// Writes docs/results/autoscale.md: how the autoscaler's policy reacts, in virtual time.
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>

#include "absl/strings/str_format.h"
#include "tests/bench/autoscale_sim.h"

namespace lumifold::sim {
namespace {

constexpr char kHead[] = R"(# The autoscaler in a simulation

A farm and an engine in virtual time; the policy (`client/autoscale/policy`) looks every 15 s. A worker has four slots, a unit takes 6 s,
a request waits 20 s for its worker, which joins 5 s later. At most 20 workers. `lumifold-autoscale` runs this same policy; the tests
of `tests/unit/autoscale/simulation_test.cc` check its bounds.

    build/release/bin/autoscale-sim docs/results/autoscale.md

)";

/// Rows around changes: all of a long quiet time are one row.
bool IsWorthARow(const AutoscaleSample& sample, const AutoscaleSample* shown) {
  return shown == nullptr || sample.wanted != shown->wanted || sample.pending != shown->pending ||
         sample.running != shown->running || sample.started != shown->started;
}

std::string PageOf(const AutoscaleCase& scenario) {
  constexpr int kMostRows = 14;
  const AutoscaleResult result = Simulate(scenario);
  std::string rows;
  int changes = 0;
  const AutoscaleSample* shown = nullptr;
  for (const AutoscaleSample& sample : result.samples)
    changes += IsWorthARow(sample, std::exchange(shown, &sample)) ? 1 : 0;
  const int every = 1 + changes / kMostRows;
  shown = nullptr;
  int row = 0;
  std::string why;
  for (const AutoscaleSample& sample : result.samples) {
    if (!IsWorthARow(sample, std::exchange(shown, &sample)) || row++ % every != 0) continue;
    rows += absl::StrFormat("| %d | %d | %d | %d | %d | %d |\n", sample.second, sample.wanted, sample.pending,
                            sample.running, sample.started, sample.queued);
    if (sample.reason.find("refused:") != std::string::npos ||
        sample.reason.find("die at") != std::string::npos ||
        sample.reason.find("is spent") != std::string::npos)
      why = sample.reason;
  }
  std::string text = absl::StrFormat("## %s\n\n", scenario.title);
  text += absl::StrFormat(
      "%d units done, the last after %d s. %d requests, at most %d at a time; %d refused, %d died at start, "
      "%d released with "
      "units. The last worker left after %d s; %.2f core-hours.\n\n",
      result.units_done, result.last_done, result.starts, result.most_active, result.refused, result.deaths,
      result.busy_released, result.gone_after, result.core_hours);
  if (!why.empty()) text += "The reason it gave: *" + why + "*.\n\n";
  text +=
      "| second | wanted | pending | running | requests so far | units queued "
      "|\n|---|---|---|---|---|---|\n" +
      rows + "\n";
  return text;
}

int Main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: autoscale-sim FILE\n";
    return 2;
  }
  std::string text = kHead;
  for (const AutoscaleCase& scenario : AutoscaleCases()) text += PageOf(scenario);
  text.pop_back();
  std::ofstream file(argv[1]);
  file << text;
  return file.flush() ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace lumifold::sim

int main(int argc, char** argv) { return lumifold::sim::Main(argc, argv); }
