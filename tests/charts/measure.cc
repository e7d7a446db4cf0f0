#include "tests/charts/measure.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/layers.h"
#include "filter/metrics/flip.h"
#include "filter/metrics/metrics.h"
#include "filter/metrics/ssim.h"
#include "tests/charts/metrics/reference_noise.h"

namespace lumifold::charts {
namespace {

constexpr int kRowVersion = 3;  // to be incremented when Judge() changes
constexpr double kLittleTime = 3;

metrics::RegionMeans Mse255Of(const ConstColorView& picture, const Reference& reference) {
  const LayeredImage& pixels = reference.film.pixels;
  if (!reference.has_halves)
    return metrics::Mse255ByRegion(picture, pixels.GetColor(layers::kNoisy), reference.regions);
  return metrics::Mse255ToHalves(picture, pixels.GetColor(layers::HalfA(layers::kNoisy)),
                                 pixels.GetColor(layers::HalfB(layers::kNoisy)), reference.regions);
}

double PixelRatio(const FilmSettings& now, const FilmSettings& then) {
  return static_cast<double>(now.width) * now.height / (static_cast<double>(then.width) * then.height);
}

}  // namespace

/// A method with the values of one run.
struct Meter::Call {
  const Method* method = nullptr;
  std::vector<float> values;

  std::string Parameters() const { return filter::FormatParameters(method->info, values); }
};

absl::StatusOr<Reference> MakeReference(std::string name, EdgedImage film) {
  if (!film.pixels.HasColor(layers::kNoisy)) return absl::NotFoundError("the reference has no layer 'noisy'");
  Reference reference{std::move(name), std::move(film), {}, 0, 0, false};
  const LayeredImage& pixels = reference.film.pixels;
  reference.regions = metrics::RegionsOf(reference.film);
  const std::string half_a = layers::HalfA(layers::kNoisy);
  const std::string half_b = layers::HalfB(layers::kNoisy);
  reference.has_halves = pixels.HasColor(half_a) && pixels.HasColor(half_b);
  if (!reference.has_halves) return reference;
  // The variance of the mean of two halves of equal size is a quarter of their squared difference.
  reference.noise = metrics::Mse255Noise(pixels.GetColor(half_a), pixels.GetColor(half_b));
  reference.rel_mse_noise = metrics::RelMseNoise(pixels.GetColor(half_a), pixels.GetColor(half_b));
  return reference;
}

bool HidesStructure(double reference_noise, double error) {
  constexpr double kMostNoiseOverError = 0.1;
  return reference_noise > kMostNoiseOverError * error;
}

void AddRendering(const RenderRates& rates, const filter::MethodInfo& method, Row* row) {
  row->render_seconds = rates.radiance * row->samples;
  if (!method.uses_auxiliary) return;
  row->auxiliary_seconds = std::max(0.0, rates.layered - rates.radiance) * row->samples + rates.geometry;
}

Errors Judge(const ConstColorView& picture, const Reference& reference, bool is_thorough) {
  const ConstColorView truth = reference.film.pixels.GetColor(layers::kNoisy);
  Errors errors;
  errors.mse255 = Mse255Of(picture, reference);
  errors.rel_mse = metrics::RelMse(picture, truth) - reference.rel_mse_noise;
  if (!is_thorough || HidesStructure(reference.noise, errors.mse255.whole)) return errors;
  if (const absl::StatusOr<double> ssim = metrics::Ssim(picture, truth); ssim.ok()) errors.ssim = *ssim;
  errors.flip = metrics::Flip(picture, truth);
  return errors;
}

Meter::Meter(MeasureOptions options, RowStore* store, std::string cache_folder, TaskPool* pool)
    : options_(std::move(options)), store_(store), cache_folder_(std::move(cache_folder)), pool_(pool) {}

absl::StatusOr<std::vector<Row>> Meter::Measure(Subject* subject, const Reference& reference) {
  if (subject->rendered.film.pixels.bounds() != reference.film.pixels.bounds()) {
    return absl::InvalidArgumentError(absl::StrCat(subject->scene, ": film and reference differ in size"));
  }
  std::vector<Row> rows;
  for (const Method* method : options_.methods) {
    const absl::StatusOr<std::vector<Row>> measured = MeasureMethod(subject, reference, *method);
    if (!measured.ok())
      return absl::Status(measured.status().code(),
                          absl::StrCat(method->info.name, ": ", measured.status().message()));
    rows.insert(rows.end(), measured->begin(), measured->end());
  }
  subject->samples.reset();
  return rows;
}

absl::StatusOr<std::vector<Row>> Meter::MeasureMethod(Subject* subject, const Reference& reference,
                                                      const Method& method) {
  Last& last = last_[absl::StrCat(subject->scene, " ", method.info.name)];
  fingerprints_.erase(method.info.name);  // that of the former film
  const Call standard = {&method, filter::DefaultsOf(method.info)};
  absl::StatusOr<Row> first = FindOrRun(subject, reference, standard);
  if (!first.ok()) return first.status();
  if (!first->not_run.empty()) return std::vector<Row>{*std::move(first)};
  const double seconds = first->render_seconds + first->filter_seconds;
  std::vector<Row> rows = {*std::move(first)};
  std::vector<std::vector<float>> points = {standard.values};
  const absl::StatusOr<std::vector<std::vector<float>>> grid = PointsOf(subject, reference, method, seconds);
  if (!grid.ok()) return grid.status();
  for (const std::vector<float>& values : *grid) {
    absl::StatusOr<Row> row = FindOrRun(subject, reference, {&method, values});
    if (!row.ok()) return row.status();
    if (!row->not_run.empty()) continue;  // has no error to compare
    rows.push_back(*std::move(row));
    points.push_back(values);
  }
  const auto best = std::min_element(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
    return a.errors.mse255.whole < b.errors.mse255.whole;
  });
  best->is_best = true;
  last = {seconds, subject->settings, points[static_cast<size_t>(best - rows.begin())]};
  std::fprintf(stderr, "%s, %d spp, %s: MSE255 %.3f, best of %zu %.3f, %.2f s\n", subject->scene.c_str(),
               static_cast<int>(subject->settings.samples), method.info.name.c_str(),
               rows.front().errors.mse255.whole, rows.size(), best->errors.mse255.whole, seconds);
  return rows;
}

/// Expected cost of the default, from the previous film of the scene; 0 if there was none.
double Meter::ExpectedSeconds(const Subject& subject, const Method& method) const {
  const auto found = last_.find(absl::StrCat(subject.scene, " ", method.info.name));
  if (found == last_.end() || found->second.settings.width == 0) return 0;
  const FilmSettings& then = found->second.settings;
  const double samples =
      method.grows_with_samples ? static_cast<double>(subject.settings.samples) / then.samples : 1.0;
  return found->second.seconds * PixelRatio(subject.settings, then) * samples;
}

/// The points of the grid without the default: those with a stored row, the best one of the film before, and
/// of the others as many as the limit allows. Stored rows count towards the limit, so that a second run finds
/// the same points.
absl::StatusOr<std::vector<std::vector<float>>> Meter::PointsOf(Subject* subject, const Reference& reference,
                                                                const Method& method, double seconds) {
  const std::vector<float> standard = filter::DefaultsOf(method.info);
  if (standard.empty()) return std::vector<std::vector<float>>();
  std::vector<std::vector<float>> points;
  std::vector<std::vector<float>> missing;
  for (const std::vector<float>& values : filter::GridOf(method.info)) {
    if (values == standard) continue;
    const absl::StatusOr<std::optional<Row>> row = FindKept(subject, reference, {&method, values});
    if (!row.ok()) return row.status();
    (row->has_value() ? points : missing).push_back(values);
  }
  const std::vector<float> best = last_[absl::StrCat(subject->scene, " ", method.info.name)].best;
  std::stable_partition(missing.begin(), missing.end(),
                        [&](const std::vector<float>& values) { return values == best; });
  for (const std::vector<float>& values : missing) {
    const double cost = seconds * static_cast<double>(points.size() + 1);
    if (values == best || cost <= options_.most_grid_seconds) points.push_back(values);
  }
  return points;
}

absl::StatusOr<Fingerprint*> Meter::FingerprintFor(const Method& method, Subject* subject) {
  auto& known = method.probe == Probe::kSmallFilms ? small_fingerprints_ : fingerprints_;
  const auto found = known.find(method.info.name);
  if (found != known.end()) return &found->second;
  absl::StatusOr<Fingerprint> fingerprint = FingerprintOf(method, subject, cache_folder_, pool_);
  if (!fingerprint.ok()) return fingerprint.status();
  return &(known[method.info.name] = *std::move(fingerprint));
}

absl::StatusOr<std::string> Meter::KeyOf(Subject* subject, const Reference& reference, const Call& call) {
  const absl::StatusOr<Fingerprint*> fingerprint = FingerprintFor(*call.method, subject);
  if (!fingerprint.ok()) return fingerprint.status();
  const std::string film = std::filesystem::path(subject->source->PathOf(subject->settings)).stem().string();
  return absl::StrFormat("%d %s %s %s:%s %016x", kRowVersion, film, reference.name, call.method->info.name,
                         call.Parameters(), (*fingerprint)->hash);
}

/// The stored row. There is none for films from files: they are identified only by name, so a row may belong
/// to another file.
absl::StatusOr<std::optional<Row>> Meter::FindKept(Subject* subject, const Reference& reference,
                                                   const Call& call) {
  if (subject->source == nullptr) return std::optional<Row>();
  const absl::StatusOr<std::string> key = KeyOf(subject, reference, call);
  if (!key.ok()) return key.status();
  return store_->Find(*key);
}

absl::StatusOr<Row> Meter::FindOrRun(Subject* subject, const Reference& reference, const Call& call) {
  absl::StatusOr<std::optional<Row>> kept = FindKept(subject, reference, call);
  if (!kept.ok()) return kept.status();
  const bool is_again =
      std::find(options_.again.begin(), options_.again.end(), call.method->info.name) != options_.again.end();
  if (kept->has_value() && !is_again) return **std::move(kept);
  absl::StatusOr<Row> row = Run(subject, reference, call);
  if (!row.ok() || !row->not_run.empty() || subject->source == nullptr) return row;
  const absl::StatusOr<std::string> key = KeyOf(subject, reference, call);
  if (!key.ok()) return key.status();
  if (const absl::Status status = store_->Add(*key, *row); !status.ok()) return status;
  return row;
}

/// The picture of a call: the one that its fingerprint was taken of, if there is one, else a new one.
absl::StatusOr<MadePicture> Meter::Make(Subject* subject, const Call& call) {
  const auto found = fingerprints_.find(call.method->info.name);
  const bool is_default = call.values == filter::DefaultsOf(call.method->info);
  if (!is_default || found == fingerprints_.end() || !found->second.made.has_value())
    return call.method->make(subject, call.values, pool_);
  MadePicture made = *std::move(found->second.made);
  found->second.made.reset();
  return made;
}

absl::StatusOr<Row> Meter::Run(Subject* subject, const Reference& reference, const Call& call) {
  Row row;
  row.scene = subject->scene;
  row.width = subject->settings.width;
  row.height = subject->settings.height;
  row.samples = static_cast<int>(subject->settings.samples);
  row.method = call.method->info.name;
  row.parameters = call.Parameters();
  row.is_default = call.values == filter::DefaultsOf(call.method->info);
  if (const double seconds = ExpectedSeconds(*subject, *call.method); seconds > options_.most_run_seconds) {
    row.not_run = absl::StrFormat("cost: %.0f s", seconds);
    return row;
  }
  absl::StatusOr<MadePicture> made = Make(subject, call);
  if (absl::IsUnimplemented(made.status())) {
    row.not_run = std::string(made.status().message());
    return row;
  }
  for (int i = 1; i < options_.timed_runs && made.ok() && row.is_default && made->seconds < kLittleTime;
       ++i) {
    const absl::StatusOr<MadePicture> more = call.method->make(subject, call.values, pool_);
    if (!more.ok()) return more.status();
    made->seconds = std::min(made->seconds, more->seconds);
  }
  if (!made.ok()) return made.status();
  row.errors = Judge(ViewOf(made->picture), reference, row.is_default);
  (call.method->renders ? row.render_seconds : row.filter_seconds) = made->seconds;
  return row;
}

}  // namespace lumifold::charts
