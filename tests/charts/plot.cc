#include "tests/charts/plot.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "filter/image/file_io.h"

namespace lumifold::charts {
namespace {

enum class Axis { kTime, kSamples };

/// Okabe & Ito's colours, told apart by the colour-blind; points differ too, and dashes where colours repeat.
constexpr std::array<const char*, 8> kColors = {"#000000", "#0072B2", "#D55E00", "#009E73",
                                                "#CC79A7", "#E69F00", "#56B4E9", "#999999"};

double AxisValue(const Row& row, Axis axis) {
  return axis == Axis::kSamples ? row.samples : row.render_seconds + row.filter_seconds;
}

/// The distinct values of a name, in the order they come.
std::vector<std::string> NamesOf(absl::Span<const Row> rows, std::string Row::*name) {
  std::vector<std::string> names;
  for (const Row& row : rows) {
    if (std::find(names.begin(), names.end(), row.*name) == names.end()) names.push_back(row.*name);
  }
  return names;
}

/// A scene's best rows of one method, by samples.
std::vector<Row> Curve(absl::Span<const Row> rows, const std::string& scene, const std::string& method) {
  std::vector<Row> curve;
  for (const Row& row : rows) {
    if (row.is_best && row.scene == scene && row.method == method && row.mse255.whole > 0)
      curve.push_back(row);
  }
  std::sort(curve.begin(), curve.end(), [](const Row& a, const Row& b) { return a.samples < b.samples; });
  return curve;
}

std::string Script(const std::string& picture, absl::Span<const Row> rows, const std::string& scene,
                   Axis axis) {
  std::string text = absl::StrFormat(
      "set terminal svg size 900,640 noenhanced background '#ffffff'\nset output '%s'\n"
      "set title '%s: error of each method, at its best parameters'\n"
      "set logscale xy\nset grid\nset key outside right\nset xlabel '%s'\nset ylabel 'MSE255'\n",
      absl::StrReplaceAll(picture, {{"'", "''"}}), scene,
      axis == Axis::kSamples ? "samples per pixel" : "seconds of rendering and filtering");
  std::string plots;
  std::string data;
  const std::vector<std::string> methods = NamesOf(rows, &Row::method);
  for (size_t i = 0; i < methods.size(); ++i) {
    const std::vector<Row> curve = Curve(rows, scene, methods[i]);
    if (curve.empty()) continue;
    absl::StrAppendFormat(&plots, "%s'-' using 1:2 with linespoints lw %d dt %d pt %d lc rgb '%s' title '%s'",
                          plots.empty() ? "plot " : ", ", methods[i] == "default" ? 4 : 2,
                          i / kColors.size() + 1, i + 1, kColors[i % kColors.size()], methods[i]);
    for (const Row& row : curve)
      absl::StrAppendFormat(&data, "%.6g %.6g\n", AxisValue(row, axis), row.mse255.whole);
    absl::StrAppend(&data, "e\n");
  }
  const std::vector<Row> noisy = Curve(rows, scene, "none");
  if (axis == Axis::kSamples && !noisy.empty()) {
    absl::StrAppendFormat(&plots, ", %.6g / x with lines dt 2 lc rgb '#666666' title 'slope -1'",
                          noisy.front().mse255.whole * noisy.front().samples);
  }
  return absl::StrCat(text, plots, "\n", data);
}

bool HasGnuplot() { return std::system("gnuplot --version >/dev/null 2>&1") == 0; }

absl::Status Draw(const std::string& base, absl::Span<const Row> rows, const std::string& scene, Axis axis,
                  bool has_gnuplot) {
  const std::string script = Script(base + ".svg", rows, scene, axis);
  const absl::Status written = WriteFileAtomically(base + ".gp", script);
  if (!written.ok() || !has_gnuplot) return written;
  // Through its standard input: no path of the user's goes through a shell.
  FILE* gnuplot = popen("gnuplot", "w");
  const bool sent = gnuplot != nullptr && std::fputs(script.c_str(), gnuplot) >= 0;
  if (gnuplot != nullptr && pclose(gnuplot) == 0 && sent) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(base, ".gp: gnuplot failed"));
}

}  // namespace

absl::StatusOr<bool> DrawCharts(const std::string& folder, absl::Span<const Row> rows) {
  const bool has_gnuplot = HasGnuplot();
  for (const std::string& scene : NamesOf(rows, &Row::scene)) {
    const bool has_times = std::any_of(rows.begin(), rows.end(), [&](const Row& row) {
      return row.scene == scene && row.render_seconds > 0;
    });
    const std::string base = absl::StrCat(folder, "/", scene);
    if (has_times) {
      const absl::Status status = Draw(base + "-time", rows, scene, Axis::kTime, has_gnuplot);
      if (!status.ok()) return status;
    }
    const absl::Status status = Draw(base + "-samples", rows, scene, Axis::kSamples, has_gnuplot);
    if (!status.ok()) return status;
  }
  return has_gnuplot;
}

}  // namespace lumifold::charts
