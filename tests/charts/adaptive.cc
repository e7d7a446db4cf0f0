#include "tests/charts/adaptive.h"

#include <cstdio>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/denoise/denoise.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"
#include "tests/charts/films/adaptive_film.h"
#include "tests/charts/series.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

AdaptivePoint AdaptivelyTo(int budget, const render::Renderer& renderer, const FilmSettings& settings,
                           const Reference& reference, TaskPool* pool) {
  const AdaptiveFilm film = RenderAdaptively(
      renderer, {.width = settings.width, .height = settings.height, .budget = static_cast<double>(budget)},
      metrics::ErrorMetric::kMse255, pool);
  AdaptivePoint point;
  point.is_adaptive = true;
  point.mse255 = Judge(ViewOf(film.picture), reference, false).mse255.whole;
  point.estimated = film.estimated_error;
  point.render_seconds = film.render_seconds;
  point.filter_seconds = film.filter_seconds;
  point.filterings = film.filterings;
  return point;
}

AdaptivePoint UniformlyTo(int budget, const render::Renderer& renderer, const FilmSettings& settings,
                          const Reference& reference, TaskPool* pool) {
  FilmSettings film_settings = settings;
  film_settings.samples = static_cast<uint32_t>(budget);
  const double start = CpuSeconds();
  const EdgedImage film = RenderFilm(renderer, film_settings, {}, pool);
  const double rendered = CpuSeconds();
  const Picture picture = filter::Denoise(filter::Frame(film), pool);
  const double filtered = CpuSeconds();
  AdaptivePoint point;
  point.mse255 = Judge(ViewOf(picture), reference, false).mse255.whole;
  point.render_seconds = rendered - start;
  point.filter_seconds = filtered - rendered;
  return point;
}

std::string NameOf(const AdaptivePoint& point) {
  return absl::StrCat(point.scene, point.is_adaptive ? ", adaptive" : ", uniform");
}

Figure ErrorFigure(const std::vector<AdaptivePoint>& points) {
  Figure figure{
      "Adaptive and uniform sampling", "processor seconds, filter and estimates included", "MSE255", {}, {}};
  for (const bool is_adaptive : {false, true}) {
    for (const AdaptivePoint& point : points) {
      if (point.is_adaptive != is_adaptive) continue;
      if (figure.curves.empty() || figure.curves.back().name != NameOf(point))
        figure.curves.push_back({NameOf(point), Curve::Style::kLine, is_adaptive, {}});
      figure.curves.back().points.emplace_back(point.TotalSeconds(), point.mse255);
    }
  }
  return figure;
}

std::string Table(const std::vector<AdaptivePoint>& points) {
  std::string text =
      TableHead({"scene", "size", "samples", "sampling", "MSE255", "estimated over true", "rendering, s",
                 "filter, s", "filterings", "time over uniform at equal error"});
  for (const AdaptivePoint& point : points) {
    const double ratio = point.is_adaptive ? TimeRatio(points, point) : 0;
    absl::StrAppend(
        &text,
        TableLine({point.scene, absl::StrCat(point.width, "x", point.height), absl::StrCat(point.budget),
                   point.is_adaptive ? "adaptive" : "uniform", absl::StrFormat("%.3f", point.mse255),
                   point.estimated < 0 ? "" : absl::StrFormat("%.2f", point.estimated / point.mse255),
                   absl::StrFormat("%.2f", point.render_seconds),
                   absl::StrFormat("%.2f", point.filter_seconds), absl::StrCat(point.filterings),
                   ratio > 0 ? absl::StrFormat("%.2f", ratio) : ""}));
  }
  return text;
}

std::string Csv(const std::vector<AdaptivePoint>& points) {
  std::string text =
      "scene,width,height,samples,adaptive,mse255,estimated,render_seconds,filter_seconds,filterings\n";
  for (const AdaptivePoint& point : points) {
    absl::StrAppendFormat(&text, "%s,%d,%d,%d,%d,%.6g,%.6g,%.4f,%.4f,%d\n", point.scene, point.width,
                          point.height, point.budget, point.is_adaptive ? 1 : 0, point.mse255,
                          point.estimated, point.render_seconds, point.filter_seconds, point.filterings);
  }
  return text;
}

}  // namespace

absl::StatusOr<std::vector<AdaptivePoint>> MeasureAdaptive(const std::string& scene, const FilmSource& source,
                                                           const FilmSettings& settings,
                                                           const Budgets& budgets, const Reference& reference,
                                                           TaskPool* pool) {
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = source.MakeRenderer(settings);
  if (!renderer.ok()) return renderer.status();
  std::vector<AdaptivePoint> points;
  for (const bool is_adaptive : {false, true}) {
    for (const int budget : is_adaptive ? budgets.adaptive : budgets.uniform) {
      AdaptivePoint point =
          (is_adaptive ? AdaptivelyTo : UniformlyTo)(budget, **renderer, settings, reference, pool);
      point.scene = scene;
      point.width = settings.width;
      point.height = settings.height;
      point.budget = budget;
      points.push_back(std::move(point));
      std::fprintf(stderr, "%s, %d spp, %s: MSE255 %.3f, %.2f s\n", scene.c_str(), budget,
                   is_adaptive ? "adaptive" : "uniform", points.back().mse255, points.back().TotalSeconds());
    }
  }
  return points;
}

double TimeRatio(const std::vector<AdaptivePoint>& points, const AdaptivePoint& adaptive) {
  std::vector<std::pair<double, double>> time_by_error;  // errors rising
  for (const AdaptivePoint& point : points) {
    if (point.scene == adaptive.scene && !point.is_adaptive)
      time_by_error.insert(time_by_error.begin(), {point.mse255, point.TotalSeconds()});
  }
  const std::optional<double> uniform = Interpolate(time_by_error, adaptive.mse255);
  return uniform.has_value() ? adaptive.TotalSeconds() / *uniform : 0;
}

absl::StatusOr<bool> ChartAdaptive(const std::string& folder, const std::vector<AdaptivePoint>& points,
                                   const Provenance& provenance, DrawFormat format) {
  absl::StatusOr<bool> drawn = Draw(folder + "/adaptive-error", ErrorFigure(points), format);
  if (!drawn.ok()) return drawn;
  if (absl::Status status = WriteFileAtomically(folder + "/adaptive.csv", Csv(points)); !status.ok())
    return status;
  const absl::Status status = WritePage(
      folder + "/adaptive.md", "Adaptive sampling", provenance,
      absl::StrCat("Samples go where the filtered picture's estimated error falls most, in blocks of 2x2 "
                   "pixels; every "
                   "estimate is part of the filter's time.\n\n![error against time](adaptive-error.svg)\n\n",
                   Table(points)));
  if (!status.ok()) return status;
  return drawn;
}

}  // namespace lumifold::charts
