// Charts error against time and samples, and the parts of the method: see docs/testing.md.
//
//   lumifold-chart --quick                                  a few minutes: two scenes, small, sanity checks
//   lumifold-chart --scenes cornell-box,atrium --spp 4,16   error charts of selected scenes
//   lumifold-chart --chart tables,stages,knee,constants,adaptive,plan,flicker --scenes ...  the other charts
//   lumifold-chart --film a.exr --reference b.exr           a saved film against a file's noisy layer
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "filter/baselines/method_info.h"
#include "filter/image/memory.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/method.h"
#include "tests/charts/run_charts.h"

namespace lumifold::charts {
namespace {

// Exit codes; 0 is success.
constexpr int kFailure = 1;
constexpr int kUsageError = 2;

void AddOptions(CLI::App* app, Options* options) {
  app->add_flag("--quick", options->quick, "Two scenes at 128x96, 4 and 16 spp, with sanity checks");
  app->add_option("--chart", options->charts,
                  "errors, tables, stages, knee, constants, adaptive, plan, flicker (default errors)")
      ->delimiter(',')
      ->check(
          CLI::IsMember({"errors", "tables", "stages", "knee", "constants", "adaptive", "plan", "flicker"}));
  app->add_option(
         "--scenes", options->scenes,
         "Generated scenes, such as cornell-box,atrium, or files of LUMIFOLD_SCENES_DIR, such as staircase")
      ->delimiter(',');
  app->add_option("--spp", options->samples, "Sample counts (default 4,16,64,256)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1 << 20));
  app->add_option("--uniform-spp", options->uniform_samples,
                  "Of uniform pictures in the chart of adaptive sampling (default as --spp)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1 << 20));
  app->add_option("--reference-spp", options->reference_samples,
                  "Samples of the reference, of all scenes or of each (default 4096)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1 << 20));
  app->add_option("--methods", options->methods, "Only these (default: all; see --list-methods)")
      ->delimiter(',');
  app->add_flag("--list-methods", options->lists_methods,
                "Print all methods with their parameters and sources, and exit");
  app->add_flag("--json", options->json, "Print that list as JSON, one object a line");
  app->add_option("--again", options->again, "Measure these again, even if results are stored")
      ->delimiter(',');
  app->add_option("--grid-seconds", options->most_grid_seconds,
                  "Limit in processor seconds for one method's grid on one film (default 120)");
  app->add_option("--run-seconds", options->most_run_seconds,
                  "Limit of one run; runs expected to exceed it are skipped (default 600)");
  app->add_option("--film-seed", options->film_seed, "Seed of the films (default 1)")
      ->check(CLI::Range(uint64_t{1}, kReferenceSeed - 1));
  app->add_option("--seeds", options->seeds, "Pairs of jobs of the chart of plans (default 8)")
      ->check(CLI::Range(1, 1000));
  app->add_option("--frames", options->frames, "Frames of the chart of flicker (default 16)")
      ->check(CLI::Range(2, 1000));
  app->add_option("--width", options->width, "Pixels (default 256)")->check(CLI::Range(1, 16384));
  app->add_option("--height", options->height, "Pixels (default 192)")->check(CLI::Range(1, 16384));
  app->add_option("--film", options->films, "A film of --save-film; needs a --reference each")
      ->allow_extra_args(false);
  app->add_option("--reference", options->references, "Its reference")->allow_extra_args(false);
  app->add_option("--output", options->output, "Folder for the results (default lumifold-charts)");
  app->add_option("--cache", options->cache, "Folder for films and measured rows (default OUTPUT/cache)");
  app->add_flag("--png", options->png, "Draw PNG beside SVG");
  app->add_option("--threads", options->threads, "Threads (default: all)")->check(CLI::Range(1, 4096));
}

bool IsUsable(const Options& options) {
  const size_t references = options.reference_samples.size();
  return options.films.size() == options.references.size() &&
         !(options.scenes.empty() && options.films.empty()) &&
         (references == 1 || references == options.scenes.size());
}

int Main(int argc, char** argv) {
  KeepFreedMemory();  // as in the programs that filter
  Options options;
  options.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  CLI::App app(
      "Charts the error of every method against time and samples, and the parts of the default.\n"
      "Exit codes: 0 done, 1 failed (with --quick: also a failed check), 2 wrong usage.",
      "lumifold-chart");
  AddOptions(&app, &options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : kUsageError;
  }
  if (options.lists_methods) {
    const std::vector<filter::MethodInfo> methods = AllMethodInfos();
    std::printf("%s", (options.json ? filter::MethodsAsJson(methods) : filter::MethodTable(methods)).c_str());
    return 0;
  }
  if (options.quick) MakeQuick(&options);
  if (!IsUsable(options)) {
    std::fprintf(stderr,
                 "lumifold-chart: give --quick, --scenes, or as many --film as --reference; and one "
                 "--reference-spp or one a scene\n");
    return kUsageError;
  }
  options.command =
      absl::StrCat("lumifold-chart ", absl::StrJoin(std::vector<std::string>(argv + 1, argv + argc), " "));
  if (options.cache.empty()) options.cache = options.output + "/cache";
  const absl::Status status = RunCharts(options);
  if (status.ok()) return 0;
  std::fprintf(stderr, "lumifold-chart: %s\n", std::string(status.message()).c_str());
  return kFailure;
}

}  // namespace
}  // namespace lumifold::charts

int main(int argc, char** argv) { return lumifold::charts::Main(argc, argv); }
