#include "tests/charts/constants.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "filter/denoise/denoise.h"
#include "filter/denoise/settings.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

double ErrorWith(const Subject& subject, const Reference& reference,
                 const std::function<void(filter::Settings*)>& adjust, TaskPool* pool) {
  const EdgedImage& film = subject.rendered.film;
  filter::DenoiseOptions options;
  options.adjust = adjust;
  const Picture picture = filter::Denoise(filter::Frame(film), pool, options);
  return Judge(ViewOf(picture), reference, false).mse255.whole;
}

/// Ratios of errors over films: their geometric mean and the largest.
class Ratios {
 public:
  void Add(double ratio) {
    logs_ += std::log(ratio);
    most_ = std::max(most_, ratio);
    ++count_;
  }
  std::string MeanCell() const {
    return count_ > 0 ? absl::StrFormat("%.3f", std::exp(logs_ / count_)) : "-";
  }
  std::string MostCell() const { return count_ > 0 ? absl::StrFormat("%.3f", most_) : "-"; }

 private:
  double logs_ = 0;
  double most_ = 0;
  int count_ = 0;
};

/// "1.8", or "6 to 8.5" for a constant that depends on the picture's size.
std::string ValueCell(absl::Span<const ConstantPoint> points) {
  const auto [least, most] =
      std::minmax_element(points.begin(), points.end(),
                          [](const ConstantPoint& a, const ConstantPoint& b) { return a.value < b.value; });
  if (least->value == most->value) return absl::StrFormat("%.4g", least->value);
  return absl::StrFormat("%.4g to %.4g", least->value, most->value);
}

std::string ConstantLine(absl::Span<const ConstantPoint> points) {
  Ratios halved;
  Ratios doubled;
  for (const ConstantPoint& point : points) {
    if (!(point.error > 0 && point.halved_error > 0 && point.doubled_error > 0)) continue;
    halved.Add(point.halved_error / point.error);
    doubled.Add(point.doubled_error / point.error);
  }
  return TableLine({points[0].constant, points[0].unit, ValueCell(points), halved.MeanCell(),
                    doubled.MeanCell(), halved.MostCell(), doubled.MostCell()});
}

/// Each film once, as "cornell-box (tuning), 256x192, 16 spp".
std::string FilmList(absl::Span<const ConstantPoint> points) {
  std::vector<std::string> films;
  for (const ConstantPoint& point : points) {
    std::string film = absl::StrCat(SceneHeading(point.scene, point.width, point.height), ", ", point.width,
                                    "x", point.height, ", ", point.samples, " spp");
    if (std::find(films.begin(), films.end(), film) == films.end()) films.push_back(std::move(film));
  }
  return absl::StrJoin(films, "; ");
}

std::string ConstantsCsv(absl::Span<const ConstantPoint> points) {
  std::string text = "scene,width,height,set,spp,constant,unit,value,mse255,mse255_halved,mse255_doubled\n";
  for (const ConstantPoint& point : points) {
    absl::StrAppendFormat(&text, "%s,%d,%d,%s,%d,%s,%s,%.6g,%.6g,%.6g,%.6g\n", point.scene, point.width,
                          point.height, SetName(point.scene, point.width, point.height), point.samples,
                          point.constant, point.unit, point.value, point.error, point.halved_error,
                          point.doubled_error);
  }
  return text;
}

}  // namespace

std::vector<ConstantPoint> MeasureConstants(const Subject& subject, const Reference& reference,
                                            TaskPool* pool) {
  const FilmSettings& film = subject.settings;
  const filter::Settings settings = filter::DefaultSettings();
  const double error = ErrorWith(subject, reference, {}, pool);
  std::vector<ConstantPoint> points;
  for (const filter::TunedConstant& constant : filter::TunedConstants()) {
    const float value = constant.Get(settings);
    const auto error_at = [&](float factor) {
      const auto adjust = [&](filter::Settings* adjusted) { constant.Set(adjusted, factor * value); };
      return ErrorWith(subject, reference, adjust, pool);
    };
    points.push_back({subject.scene, film.width, film.height, static_cast<int>(film.samples),
                      std::string(constant.name), std::string(constant.unit), static_cast<double>(value),
                      error, error_at(0.5f), error_at(2)});
  }
  return points;
}

std::string ConstantsTable(absl::Span<const ConstantPoint> points) {
  std::string text = TableHead({"constant", "unit", "value", "error, halved", "error, doubled",
                                "halved, largest of a film", "doubled, largest of a film"});
  std::vector<std::string> done;
  for (const ConstantPoint& first : points) {
    if (std::find(done.begin(), done.end(), first.constant) != done.end()) continue;
    done.push_back(first.constant);
    std::vector<ConstantPoint> of_constant;
    std::copy_if(points.begin(), points.end(), std::back_inserter(of_constant),
                 [&](const ConstantPoint& point) { return point.constant == first.constant; });
    absl::StrAppend(&text, ConstantLine(of_constant));
  }
  return text;
}

absl::Status WriteConstants(const std::string& folder, absl::Span<const ConstantPoint> points,
                            const Provenance& provenance) {
  if (absl::Status status = WriteFileAtomically(folder + "/constants.csv", ConstantsCsv(points));
      !status.ok())
    return status;
  return WritePage(
      folder + "/constants.md", "What halving and doubling each constant costs", provenance,
      absl::StrCat("MSE255 of the default method with one constant halved or doubled, divided by "
                   "MSE255 with all constants as they are: geometric mean over the films, and "
                   "the largest of a film. A ratio above 1 is what the change costs. Errors are "
                   "without the noise of the references.\n\nFilms: ",
                   FilmList(points), ".\n\n", ConstantsTable(points)));
}

}  // namespace lumifold::charts
