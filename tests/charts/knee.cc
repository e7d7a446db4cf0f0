#include "tests/charts/knee.h"

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/denoise/denoise.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"
#include "tests/charts/figure.h"
#include "tests/charts/tuning_set.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

constexpr char kNothing[] = "nothing";

/// What can be left out, by name: first nothing, then each guide and each stage that can be switched off.
std::vector<std::string> PartNames() {
  std::vector<std::string> names = {kNothing};
  for (const filter::GuideInfo& guide : filter::Guides()) names.emplace_back(guide.name);
  for (const filter::StageInfo& stage : filter::Stages()) {
    if (!stage.is_required) names.emplace_back(stage.name);
  }
  return names;
}

const KneePoint& WholeOf(const std::vector<KneePoint>& points, const KneePoint& like) {
  return *std::find_if(points.begin(), points.end(), [&](const KneePoint& point) {
    return point.scene == like.scene && point.samples == like.samples && point.part == kNothing;
  });
}

/// What a point is relative to the whole method.
struct KneeRatios {
  double error = 0;
  double cost = 0;
};

KneeRatios RatiosOf(const std::vector<KneePoint>& points, const KneePoint& point) {
  const KneePoint& whole = WholeOf(points, point);
  return {point.errors.mse255.whole / whole.errors.mse255.whole, point.seconds / whole.seconds};
}

Figure KneeFigure(const std::vector<KneePoint>& points, const std::string& title, const std::string& label,
                  double KneeRatios::* value) {
  Figure figure{title, label, "", {}, {}};
  for (const std::string& name : PartNames()) {
    if (name != kNothing) figure.rows.push_back(name);
  }
  for (const KneePoint& point : points) {
    const auto row = std::find(figure.rows.begin(), figure.rows.end(), point.part);
    if (row == figure.rows.end()) continue;
    const std::string name = absl::StrCat(point.scene, ", ", point.samples, " spp");
    if (figure.curves.empty() || figure.curves.back().name != name)
      figure.curves.push_back({name, Curve::Style::kDots, false, {}});
    figure.curves.back().points.emplace_back(RatiosOf(points, point).*value,
                                             static_cast<double>(row - figure.rows.begin()));
  }
  const auto last_row = static_cast<double>(figure.rows.size());
  figure.curves.push_back({"the whole method", Curve::Style::kGuide, false, {{1, -0.8}, {1, last_row}}});
  return figure;
}

std::string KneeTable(const std::vector<KneePoint>& points) {
  std::string text =
      TableHead({"scene", "set", "spp", "without", "MSE255", "over the whole method's", "edges", "mirror",
                 "shadow", "textured", "flat", "processor seconds", "cost over the whole's"});
  for (const KneePoint& point : points) {
    const KneeRatios ratios = RatiosOf(points, point);
    std::vector<std::string> cells = {point.scene,
                                      SetName(point.scene, point.width, point.height),
                                      absl::StrCat(point.samples),
                                      point.part,
                                      absl::StrFormat("%.3f", point.errors.mse255.whole),
                                      absl::StrFormat("%.3f", ratios.error)};
    for (const double error : point.errors.mse255.of_region) cells.push_back(absl::StrFormat("%.2f", error));
    cells.push_back(absl::StrFormat("%.2f", point.seconds));
    cells.push_back(absl::StrFormat("%.2f", ratios.cost));
    absl::StrAppend(&text, TableLine(cells));
  }
  return text;
}

std::string KneeCsv(const std::vector<KneePoint>& points) {
  std::string text = "scene,width,height,set,spp,without,mse255,rel_mse,ssim,flip,processor_seconds\n";
  for (const KneePoint& point : points) {
    absl::StrAppendFormat(&text, "%s,%d,%d,%s,%d,%s,%.6g,%.6g,%s,%s,%.4f\n", point.scene, point.width,
                          point.height, SetName(point.scene, point.width, point.height), point.samples,
                          point.part, point.errors.mse255.whole, point.errors.rel_mse,
                          CsvCell(point.errors.ssim), CsvCell(point.errors.flip), point.seconds);
  }
  return text;
}

}  // namespace

std::vector<KneePoint> MeasureKnee(const Subject& subject, const Reference& reference, TaskPool* pool) {
  constexpr int kRounds = 3;
  const EdgedImage& film = subject.rendered.film;
  std::vector<KneePoint> points;
  for (const std::string& name : PartNames()) {
    points.push_back({subject.scene,
                      subject.settings.width,
                      subject.settings.height,
                      static_cast<int>(subject.settings.samples),
                      name,
                      {},
                      std::numeric_limits<double>::max()});
  }
  // In turns: what slows the machine down for a while slows all of them.
  for (int round = 0; round < kRounds; ++round) {
    for (KneePoint& point : points) {
      filter::DenoiseOptions options;
      if (point.part != kNothing) options.off.push_back(point.part);
      const double start = CpuSeconds();
      const Picture picture = filter::Denoise(filter::Frame(film), pool, options);
      point.seconds = std::min(point.seconds, CpuSeconds() - start);
      if (round == 0) point.errors = Judge(ViewOf(picture), reference, true);
    }
  }
  return points;
}

absl::StatusOr<bool> ChartKnee(const std::string& folder, const std::vector<KneePoint>& points,
                               const Provenance& provenance, DrawFormat format) {
  absl::StatusOr<bool> drawn = Draw(folder + "/knee-error",
                                    KneeFigure(points, "Error without one part of the method",
                                               "MSE255 over that of the whole method", &KneeRatios::error),
                                    format);
  if (!drawn.ok()) return drawn;
  absl::StatusOr<bool> cost_drawn =
      Draw(folder + "/knee-cost",
           KneeFigure(points, "Cost without one part of the method",
                      "filter's time over that of the whole method", &KneeRatios::cost),
           format);
  if (!cost_drawn.ok()) return cost_drawn;
  if (absl::Status status = WriteFileAtomically(folder + "/knee.csv", KneeCsv(points)); !status.ok())
    return status;
  absl::Status status = WritePage(
      folder + "/knee.md", "What each part of the method buys", provenance,
      absl::StrCat("The default method with one part left out at a time. A ratio of errors over 1 is what "
                   "the part takes off; a ratio of costs below 1 is what it takes. Parameters were chosen "
                   "on scenes of the tuning set, not on judged ones.\n\n"
                   "![error](knee-error.svg)\n\n![cost](knee-cost.svg)\n\n",
                   KneeTable(points)));
  if (!status.ok()) return status;
  return drawn;
}

}  // namespace lumifold::charts
