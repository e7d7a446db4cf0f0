#include "tests/charts/error_charts.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "tests/charts/figure.h"
#include "tests/charts/region_report.h"
#include "tests/charts/series.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

using Points = std::vector<std::pair<double, double>>;

enum class Axis { kTime, kSamples };

bool IsOurs(const std::string& method) { return method == "default"; }

/// The Pareto front of error and time, by time.
Points FrontOf(absl::Span<const Row> rows, const std::string& scene) {
  Points points;
  for (const Row& row : rows) {
    if (row.scene == scene && row.not_run.empty() && row.errors.mse255.whole > 0)
      points.emplace_back(row.TotalSeconds(), row.errors.mse255.whole);
  }
  std::sort(points.begin(), points.end());
  Points front;
  for (const auto& point : points) {
    if (front.empty() || point.second < front.back().second) front.push_back(point);
  }
  return front;
}

Figure ErrorFigure(absl::Span<const Row> rows, const std::string& scene, Axis axis) {
  const bool is_time = axis == Axis::kTime;
  Figure figure{absl::StrCat(scene, ": error of each method, at its best parameters"),
                is_time ? "processor seconds: rendering, auxiliary data and filtering" : "samples per pixel",
                "MSE255",
                {},
                {}};
  for (const std::string& method : MethodsOf(rows)) {
    Curve curve{method, Curve::Style::kLine, IsOurs(method), {}};
    for (const Row& row : BestRows(rows, scene, method))
      curve.points.emplace_back(is_time ? row.TotalSeconds() : row.samples, row.errors.mse255.whole);
    figure.curves.push_back(std::move(curve));
  }
  if (is_time) {
    figure.curves.push_back({"Pareto front", Curve::Style::kStairs, false, FrontOf(rows, scene)});
    return figure;
  }
  const std::vector<Row> noisy = BestRows(rows, scene, "none");
  if (noisy.size() < 2) return figure;
  const double product = noisy.front().errors.mse255.whole * noisy.front().samples;
  Curve slope{"slope -1", Curve::Style::kGuide, false, {}};
  for (const Row* end : {&noisy.front(), &noisy.back()})
    slope.points.emplace_back(end->samples, product / end->samples);
  figure.curves.push_back(std::move(slope));
  return figure;
}

/// The time at which the unfiltered picture reaches an error: interpolated on its curve, and beyond its last
/// point extrapolated with slope -1. Curve: by rising error; nothing for fewer than two points.
std::optional<double> SecondsTo(const Points& unfiltered, double error) {
  if (unfiltered.size() < 2) return std::nullopt;
  const auto& [least_error, most_seconds] = unfiltered.front();
  return error < least_error ? most_seconds * least_error / error : Interpolate(unfiltered, error);
}

/// For each row of the default, by samples: time of the unfiltered picture to the same error over its time.
Points SpeedUps(absl::Span<const Row> rows, const std::string& scene) {
  Points time_by_error = ErrorByTime(BestRows(rows, scene, "none"));
  for (auto& point : time_by_error) std::swap(point.first, point.second);
  std::sort(time_by_error.begin(), time_by_error.end());
  Points ratios;
  for (const Row& row : DefaultRows(rows, scene, "default")) {
    const std::optional<double> seconds = SecondsTo(time_by_error, row.errors.mse255.whole);
    if (seconds.has_value()) ratios.emplace_back(row.samples, *seconds / row.TotalSeconds());
  }
  return ratios;
}

bool HasSpeedUps(absl::Span<const Row> rows) {
  const std::vector<std::string> scenes = ScenesOf(rows);
  return std::any_of(scenes.begin(), scenes.end(),
                     [&](const std::string& scene) { return !SpeedUps(rows, scene).empty(); });
}

Figure SpeedUpFigure(absl::Span<const Row> rows) {
  Figure figure{"Speed-up at equal error over unfiltered path tracing",
                "samples per pixel of the filtered film",
                "time of unfiltered / time of default",
                {},
                {}};
  double least = 1e9;
  double most = 0;
  for (const std::string& scene : ScenesOf(rows)) {
    figure.curves.push_back({scene, Curve::Style::kLine, false, SpeedUps(rows, scene)});
    for (const auto& point : figure.curves.back().points) {
      least = std::min(least, point.first);
      most = std::max(most, point.first);
    }
  }
  if (most <= least) return figure;
  for (const auto& [name, value] :
       {std::pair("the paper's least, 8.5", 8.5), {"the paper's most, 11.4", 11.4}, {"target, 20", 20.0}})
    figure.curves.push_back({name, Curve::Style::kGuide, false, {{least, value}, {most, value}}});
  return figure;
}

std::string SpeedUpTable(absl::Span<const Row> rows) {
  std::string text = TableHead({"scene", "set", "spp", "MSE255", "processor seconds", "speed-up"});
  for (const std::string& scene : ScenesOf(rows)) {
    const Points ratios = SpeedUps(rows, scene);
    for (const Row& row : DefaultRows(rows, scene, "default")) {
      const auto found = std::find_if(ratios.begin(), ratios.end(), [&](const auto& point) {
        return point.first == static_cast<double>(row.samples);
      });
      absl::StrAppend(&text,
                      TableLine({scene, SetName(scene, row.width, row.height), absl::StrCat(row.samples),
                                 absl::StrFormat("%.3f", row.errors.mse255.whole),
                                 absl::StrFormat("%.2f", row.TotalSeconds()),
                                 found == ratios.end() ? "outside the rendered range"
                                                       : absl::StrFormat("%.1f", found->second)}));
    }
  }
  return text;
}

/// The default's error, interpolated at the total time of each method's points, over the method's error: the
/// geometric mean over the points within the default's range of times.
std::string EqualTimeTable(absl::Span<const Row> rows) {
  const std::vector<std::string> scenes = ScenesOf(rows);
  std::vector<std::string> head = {"method"};
  for (const std::string& scene : scenes) head.push_back(HeadingOf(rows, scene));
  std::string text = TableHead(head);
  for (const std::string& method : MethodsOf(rows)) {
    if (IsOurs(method)) continue;
    std::vector<std::string> cells = {method};
    for (const std::string& scene : scenes) {
      const Points ours = ErrorByTime(DefaultRows(rows, scene, "default"));
      double sum = 0;
      int count = 0;
      for (const auto& [seconds, error] : ErrorByTime(BestRows(rows, scene, method))) {
        const std::optional<double> at_equal_time = Interpolate(ours, seconds);
        if (!at_equal_time.has_value()) continue;
        sum += std::log(*at_equal_time / error);
        ++count;
      }
      cells.push_back(count > 0 ? absl::StrFormat("%.3f (%d)", std::exp(sum / count), count)
                                : "none in range");
    }
    absl::StrAppend(&text, TableLine(cells));
  }
  return text;
}

/// The slope of each method's error over samples, as a power, between its last two points; unfiltered
/// sampling has -1.
std::string SlopeTable(absl::Span<const Row> rows) {
  const std::vector<std::string> scenes = ScenesOf(rows);
  std::vector<std::string> head = {"method"};
  for (const std::string& scene : scenes) head.push_back(HeadingOf(rows, scene));
  std::string text = TableHead(head);
  for (const std::string& method : MethodsOf(rows)) {
    std::vector<std::string> cells = {method};
    for (const std::string& scene : scenes) {
      const std::vector<Row> curve = BestRows(rows, scene, method);
      if (curve.size() < 2) {
        cells.emplace_back("");
        continue;
      }
      const Row& a = curve[curve.size() - 2];
      const Row& b = curve.back();
      cells.push_back(absl::StrFormat("%.2f (%d to %d)",
                                      std::log(b.errors.mse255.whole / a.errors.mse255.whole) /
                                          std::log(static_cast<double>(b.samples) / a.samples),
                                      a.samples, b.samples));
    }
    absl::StrAppend(&text, TableLine(cells));
  }
  return text;
}

std::string PageOf(absl::Span<const Row> rows, absl::Span<const Truth> truths, bool has_times) {
  std::string text =
      "MSE255 of whole pictures, without the noise of the reference. Time is the sum of processor "
      "seconds over all threads for rendering, auxiliary data (layers, halves, features) and filter. "
      "Unfiltered pictures, and methods that work on them alone, pay for the rendering of C only. Every "
      "method except the default is shown at the point of its grid that is best for that film, which "
      "favours it. The default's parameters were chosen on films of the tuning set; judged films played no "
      "part in that. `errors.csv` has every run, with regions, relMSE, SSIM and FLIP.\n\n";
  for (const std::string& scene : ScenesOf(rows)) {
    const std::string heading = HeadingOf(rows, scene);
    if (has_times) absl::StrAppend(&text, "![", heading, ", error against time](", scene, "-time.svg)\n\n");
    absl::StrAppend(&text, "![", heading, ", error against samples](", scene, "-samples.svg)\n\n");
  }
  absl::StrAppend(&text, "## At equal samples\n\nMSE255 of the default, divided by each method's best.\n\n",
                  RatioTable(rows));
  absl::StrAppend(
      &text, "\n## By region\n\n", LossesText(rows),
      "\nMSE255 of the whole picture and of its regions: edges, what is seen in mirrors and through "
      "glass, shadow bands, textures, and flat surfaces. SSIM and FLIP are measured at default "
      "parameters, and left out where the reference's noise is more than a tenth of the error: "
      "there they would measure the reference.\n\n",
      RegionTable(rows));
  if (has_times) {
    absl::StrAppend(
        &text,
        "\n## At equal time\n\nMSE255 of the default, interpolated at the total time of each point of "
        "the method, divided by the method's: geometric mean, and the number of points within the "
        "default's curve.\n\n",
        EqualTimeTable(rows));
  }
  absl::StrAppend(
      &text,
      "\n## Convergence\n\nThe slope of error over samples between the last two points; unfiltered sampling "
      "has -1.\n\n",
      SlopeTable(rows));
  if (HasSpeedUps(rows)) {
    absl::StrAppend(
        &text,
        "\n## Speed-up at equal error\n\n![speed-up](speed-up.svg)\n\nThe time that unfiltered path tracing "
        "(C only) takes to reach the default's error, divided by the default's total time. It is "
        "interpolated "
        "on the curve of unfiltered path tracing, and extrapolated with slope -1 beyond its last point.\n\n",
        SpeedUpTable(rows));
  }
  if (!truths.empty()) absl::StrAppend(&text, "\n## References\n\n", TruthTable(truths));
  return text;
}

}  // namespace

absl::StatusOr<bool> ChartErrors(const std::string& folder, absl::Span<const Row> rows,
                                 absl::Span<const Truth> truths, const Provenance& provenance,
                                 DrawFormat format) {
  const bool has_times =
      std::any_of(rows.begin(), rows.end(), [](const Row& row) { return row.render_seconds > 0; });
  bool is_drawn = true;
  const auto draw = [&](const std::string& name, const Figure& figure) {
    const absl::StatusOr<bool> drawn = Draw(absl::StrCat(folder, "/", name), figure, format);
    is_drawn &= drawn.value_or(false);
    return drawn.status();
  };
  for (const std::string& scene : ScenesOf(rows)) {
    absl::Status status = draw(scene + "-samples", ErrorFigure(rows, scene, Axis::kSamples));
    if (status.ok() && has_times) status = draw(scene + "-time", ErrorFigure(rows, scene, Axis::kTime));
    if (!status.ok()) return status;
  }
  if (HasSpeedUps(rows)) {
    if (const absl::Status status = draw("speed-up", SpeedUpFigure(rows)); !status.ok()) return status;
  }
  if (const absl::Status status = WriteCsv(folder + "/errors.csv", rows); !status.ok()) return status;
  const absl::Status status = WritePage(folder + "/errors.md", "Error against time and samples", provenance,
                                        PageOf(rows, truths, has_times));
  if (!status.ok()) return status;
  return is_drawn;
}

}  // namespace lumifold::charts
