#include "tests/charts/measure.h"

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "filter/baselines/baseline.h"
#include "filter/image/layers.h"
#include "filter/methods.h"

namespace lumifold::charts {
namespace {

/// A method and the parameters of one run, as FilterFilm and a row have them.
struct Call {
  std::string method;
  std::string parameters;
  bool is_default = true;

  std::string Text() const { return parameters.empty() ? method : absl::StrCat(method, ":", parameters); }
};

std::vector<Call> CallsOf(const filter::Baseline& baseline) {
  std::vector<std::vector<float>> points = filter::GridOf(baseline);
  const std::vector<float> defaults = filter::DefaultsOf(baseline);
  if (std::find(points.begin(), points.end(), defaults) == points.end()) points.push_back(defaults);
  std::vector<Call> calls;
  for (const std::vector<float>& values : points)
    calls.push_back({baseline.name, filter::FormatParameters(baseline, values), values == defaults});
  return calls;
}

RegionMeans Minus(RegionMeans error, const RegionMeans& noise) {
  error.whole -= noise.whole;
  for (size_t i = 0; i < kRegionCount; ++i) error.of_region[i] -= noise.of_region[i];
  return error;
}

absl::StatusOr<Row> Run(const Subject& subject, const Reference& reference, const Call& call,
                        TaskPool* pool) {
  const EdgedImage& film = subject.timed.film;
  const absl::Time start = absl::Now();
  const absl::StatusOr<std::array<Plane, 3>> picture =
      filter::FilterFilm(film.pixels, call.Text(), pool, &film.edges);
  const double seconds = absl::ToDoubleSeconds(absl::Now() - start);
  if (!picture.ok()) return picture.status();
  const RegionMeans error = Mse255ByRegion({(*picture)[0].view(), (*picture)[1].view(), (*picture)[2].view()},
                                           reference.film.pixels.GetColor(layers::kNoisy), reference.regions);
  Row row;
  row.scene = subject.scene;
  row.samples = subject.samples;
  row.method = call.method;
  row.parameters = call.parameters;
  row.is_default = call.is_default;
  row.mse255 = Minus(error, reference.noise);
  row.render_seconds = subject.timed.render_seconds;
  row.filter_seconds = call.method == "none" ? 0 : seconds;
  return row;
}

/// Appends the rows of one method's calls, the best marked.
absl::Status RunAll(const Subject& subject, const Reference& reference, const std::vector<Call>& calls,
                    TaskPool* pool, std::vector<Row>* rows) {
  const auto first = static_cast<std::ptrdiff_t>(rows->size());
  for (const Call& call : calls) {
    absl::StatusOr<Row> row = Run(subject, reference, call, pool);
    if (!row.ok()) return row.status();
    rows->push_back(*std::move(row));
  }
  const auto best = std::min_element(rows->begin() + first, rows->end(), [](const Row& a, const Row& b) {
    return a.mse255.whole < b.mse255.whole;
  });
  best->is_best = true;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Reference> MakeReference(EdgedImage film) {
  if (!film.pixels.HasColor(layers::kNoisy)) return absl::NotFoundError("the reference has no layer 'noisy'");
  Reference reference{std::move(film), {}, {}, false};
  const LayeredImage& pixels = reference.film.pixels;
  reference.regions = RegionsOf(reference.film);
  const std::string half_a = layers::HalfA(layers::kNoisy);
  const std::string half_b = layers::HalfB(layers::kNoisy);
  reference.has_halves = pixels.HasColor(half_a) && pixels.HasColor(half_b);
  if (!reference.has_halves) return reference;
  // The variance of the mean of two halves of equal size is a quarter of their squared difference.
  reference.noise = Mse255ByRegion(pixels.GetColor(half_a), pixels.GetColor(half_b), reference.regions);
  reference.noise.whole /= 4;
  for (double& noise : reference.noise.of_region) noise /= 4;
  return reference;
}

absl::StatusOr<std::vector<Row>> Measure(const Subject& subject, const Reference& reference, TaskPool* pool) {
  if (subject.timed.film.pixels.bounds() != reference.film.pixels.bounds()) {
    return absl::InvalidArgumentError(absl::StrCat(subject.scene, ": film and reference differ in size"));
  }
  std::vector<Row> rows;
  for (const char* ours : {"none", "default", "paper"}) {
    const absl::Status status = RunAll(subject, reference, {{ours, "", true}}, pool, &rows);
    if (!status.ok()) return status;
  }
  for (const filter::Baseline& baseline : filter::Baselines()) {
    const absl::Status status = RunAll(subject, reference, CallsOf(baseline), pool, &rows);
    if (!status.ok()) return status;
  }
  return rows;
}

}  // namespace lumifold::charts
