#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace lumifold::charts {

/// The options of the program; its help explains them.
struct Options {
  bool quick = false;
  bool lists_methods = false;
  bool json = false;
  std::vector<std::string> charts = {"errors"};
  std::vector<std::string> scenes;
  std::vector<int> samples = {4, 16, 64, 256};
  std::vector<int> uniform_samples;             // of the chart of adaptive sampling; empty: as `samples`
  std::vector<int> reference_samples = {4096};  // one, or one a scene
  std::vector<std::string> methods;             // empty: all
  std::vector<std::string> again;
  double most_grid_seconds = 120;
  double most_run_seconds = 600;
  int timed_runs = 3;
  uint64_t film_seed = 1;
  int seeds = 8;    // pairs of the chart of plans
  int frames = 16;  // of the chart of flicker
  int width = 256;
  int height = 192;
  std::vector<std::string> films;
  std::vector<std::string> references;
  std::string output = "lumifold-charts";
  std::string cache;
  bool png = false;  // draw PNG beside SVG
  int threads = 1;
  std::string command;  // the command line, for the pages
};

/// The options of --quick.
void MakeQuick(Options* options);

/// Measures and draws the requested charts. Errors: those of its parts; with --quick also those of
/// CheckOrder().
absl::Status RunCharts(const Options& options);

}  // namespace lumifold::charts
