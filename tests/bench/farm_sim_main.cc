// Plays a large farm with the scheduler in virtual time: see docs/scale.md.
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <string>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "tests/bench/evidence_farm.h"
#include "tests/bench/farm_sim.h"
#include "tests/bench/finish_sim.h"

namespace lumifold::sim {
namespace {

void Print(const FarmResult& result) {
  const double bound = absl::ToDoubleSeconds(result.ideal + result.longest_unit);
  const double makespan = absl::ToDoubleSeconds(result.makespan);
  std::cout << absl::StrFormat("finished          %s\n", result.finished ? "yes" : "NO")
            << absl::StrFormat("units             %d\n", result.units)
            << absl::StrFormat("leases            %d, %d of them second ones\n", result.leases,
                               result.second_leases)
            << absl::StrFormat("makespan          %.0f s\n", makespan)
            << absl::StrFormat("last unit leased  %.0f s\n", absl::ToDoubleSeconds(result.last_leased))
            << absl::StrFormat("total work/speed  %.0f s, makespan / this = %.3f\n",
                               absl::ToDoubleSeconds(result.ideal),
                               makespan / absl::ToDoubleSeconds(result.ideal))
            << absl::StrFormat("+ longest unit    %.0f s, makespan / this = %.3f\n", bound, makespan / bound)
            << absl::StrFormat("unfairness        %.3f, in the minute before %.0f s\n", result.unfairness,
                               absl::ToDoubleSeconds(result.unfair_at))
            << absl::StrFormat("longest wait      %.1f s, until %.0f s\n",
                               absl::ToDoubleSeconds(result.longest_wait),
                               absl::ToDoubleSeconds(result.waited_at))
            << absl::StrFormat("scene loads       %d\n", result.scene_loads)
            << absl::StrFormat("deaths            %d\n", result.deaths)
            << absl::StrFormat("heartbeats        %d\n", result.heartbeats)
            << absl::StrFormat("scheduler         %d calls, %.1f us each\n", result.calls,
                               result.scheduler_seconds / static_cast<double>(result.calls) * 1e6)
            << absl::StrFormat("memory            %.0f MB\n",
                               static_cast<double>(result.scheduler_bytes) / 1e6)
            << absl::StrFormat("faulty found      %d, units redone %d, wrong units left %d\n",
                               result.faulty_found, result.units_redone, result.wrong_units);
}

/// The table of docs/scale.md: an animation whose frames take 8.5 s to render with 8 samples, and 41.6 with
/// 64.
void PrintFinishing() {
  std::cout << "| workers | samples | frames an hour, one filter on the coordinator | share | with workers "
               "that finish | "
               "share | by workers | with workers that keep frames | share "
               "|\n|---|---|---|---|---|---|---|---|---|\n";
  for (const auto& [samples, seconds] : {std::pair{8, 8.5}, std::pair{64, 41.6}}) {
    for (const int workers : {1, 2, 4, 8, 16, 64}) {
      FinishSettings settings = {.workers = workers, .render_seconds = seconds};
      const FinishResult with = SimulateFinishing(settings);
      settings.workers_keep = true;
      const FinishResult kept = SimulateFinishing(settings);
      settings.workers_keep = false;
      settings.workers_finish = false;
      settings.processes = 1;
      const FinishResult without = SimulateFinishing(settings);
      std::cout << absl::StrFormat("| %d | %d | %.0f | %.2f | %.0f | %.2f | %.2f | %.0f | %.2f |\n", workers,
                                   samples, without.frames_per_hour, without.share, with.frames_per_hour,
                                   with.share, with.finished_by_workers, kept.frames_per_hour, kept.share);
    }
  }
}

/// The table of docs/scale.md: what a bad machine and a bad job cost.
void PrintEvidence() {
  std::cout
      << "| bad machine | alone for | innocent jobs failed | leases that it spoiled | makespan | reasons "
         "after a minute |\n|---|---|---|---|---|---|\n";
  const FarmResult good = Simulate(EvidenceFarm());
  std::cout << absl::StrFormat("| none | | %d | 0 | %.2f | |\n", good.innocent_failed,
                               absl::FDivDuration(good.makespan, good.ideal));
  for (const auto& [misdeed, name] : kMisdeeds) {
    for (const absl::Duration alone : {absl::ZeroDuration(), AloneFor(misdeed)}) {
      FarmSettings settings = EvidenceFarm();
      settings.bad_machines = 1;
      settings.misdeed = misdeed;
      settings.alone = alone;
      const FarmResult result = Simulate(settings);
      std::cout << absl::StrFormat("| %s | %.0f s | %d | %d | %.2f | %s |\n", name,
                                   absl::ToDoubleSeconds(alone), result.innocent_failed,
                                   result.spoiled_by_machines,
                                   absl::FDivDuration(result.makespan - alone, result.ideal), result.reasons);
    }
  }
  std::cout
      << "\n| bad job | leases of it | workers that it ended | innocent jobs failed |\n|---|---|---|---|\n";
  for (const auto& [badness, name] :
       {std::pair{BadJob::kFails, "fails"}, std::pair{BadJob::kCrashes, "crashes"}}) {
    FarmSettings settings = EvidenceFarm();
    settings.bad_jobs = 1;
    settings.badness = badness;
    const FarmResult result = Simulate(settings);
    std::cout << absl::StrFormat("| %s | %d | %d | %d |\n", name, result.spoiled_by_jobs,
                                 result.workers_ended, result.innocent_failed);
  }
  std::cout << "\n| workers | that fail each frame | frames an hour | of what all finish | failures |\n"
               "|---|---|---|---|---|\n";
  for (const auto& [workers, failing] :
       {std::pair{4, 1}, std::pair{8, 1}, std::pair{16, 1}, std::pair{16, 4}}) {
    const FinishResult all = SimulateFinishing({.workers = workers});
    const FinishResult result = SimulateFinishing({.workers = workers, .failing_workers = failing});
    std::cout << absl::StrFormat("| %d | %d | %.0f | %.2f | %d |\n", workers, failing, result.frames_per_hour,
                                 result.frames_per_hour / all.frames_per_hour, result.failures);
  }
}

int Main(int argc, char** argv) {
  if (argc == 2 && std::string(argv[1]) == "--finishing") {
    PrintFinishing();
    return EXIT_SUCCESS;
  }
  if (argc == 2 && std::string(argv[1]) == "--evidence") {
    PrintEvidence();
    return EXIT_SUCCESS;
  }
  FarmSettings settings;
  const std::map<std::string, std::function<void(double)>> options{
      {"--seed", [&](double x) { settings.seed = static_cast<uint32_t>(x); }},
      {"--workers", [&](double x) { settings.workers = static_cast<int>(x); }},
      {"--users", [&](double x) { settings.users = static_cast<int>(x); }},
      {"--jobs", [&](double x) { settings.jobs = static_cast<int>(x); }},
      {"--units", [&](double x) { settings.units = static_cast<int64_t>(x); }},
      {"--frames", [&](double x) { settings.frames_per_job = static_cast<int>(x); }},
      {"--slowest", [&](double x) { settings.slowest = x; }},
      {"--unit-seconds", [&](double x) { settings.mean_unit = absl::Seconds(x); }},
      {"--unit-spread", [&](double x) { settings.unit_spread = x; }},
      {"--unit-scale", [&](double x) { settings.unit_scale = x; }},
      {"--stragglers", [&](double x) { settings.straggler_share = x; }},
      {"--hangs", [&](double x) { settings.hang_share = x; }},
      {"--arrivals", [&](double x) { settings.arrivals = absl::Seconds(x); }},
      {"--priority", [&](double x) { settings.high_priority = static_cast<int>(x); }},
      {"--audits", [&](double x) { settings.audit_share = x; }},
      {"--liars", [&](double x) { settings.bad_machines = static_cast<int>(x); }},
      {"--scene-load", [&](double x) { settings.scene_load = absl::Seconds(x); }},
      {"--max-frames", [&](double x) { settings.max_active_frames = static_cast<int>(x); }},
  };
  for (int i = 1; i < argc; i += 2) {
    const auto option = options.find(argv[i]);
    double value = 0;
    if (option == options.end() || i + 1 == argc || !absl::SimpleAtod(argv[i + 1], &value)) {
      std::cerr << "farm-sim: expected --finishing, --evidence, or pairs of an option and a number; got '"
                << argv[i] << "'. Options:";
      for (const auto& [name, set] : options) std::cerr << " " << name;
      std::cerr << "\n";
      return EXIT_FAILURE;
    }
    option->second(value);
  }
  const FarmResult result = Simulate(settings);
  Print(result);
  return result.finished ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace
}  // namespace lumifold::sim

int main(int argc, char** argv) { return lumifold::sim::Main(argc, argv); }
