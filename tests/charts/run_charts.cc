#include "tests/charts/run_charts.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/charts/adaptive.h"
#include "tests/charts/constants.h"
#include "tests/charts/error_charts.h"
#include "tests/charts/films/film_source.h"
#include "tests/charts/flicker.h"
#include "tests/charts/knee.h"
#include "tests/charts/measure.h"
#include "tests/charts/paper_tables.h"
#include "tests/charts/plan.h"
#include "tests/charts/report.h"
#include "tests/charts/row_store.h"
#include "tests/charts/stages.h"

namespace lumifold::charts {
namespace {

/// The largest sample count of any pixel.
int SamplesOf(const LayeredImage& film) {
  float most = 0;
  if (!film.Has(layers::kSamplesA) || !film.Has(layers::kSamplesB)) return 0;
  const ConstFloatView a = film.Get(layers::kSamplesA);
  const ConstFloatView b = film.Get(layers::kSamplesB);
  ForEachPixel(film.width(), film.height(),
               [&](int x, int y) { most = std::max(most, a.At(x, y) + b.At(x, y)); });
  return static_cast<int>(most);
}

absl::StatusOr<Reference> ReadReference(const std::string& path) {
  absl::StatusOr<EdgedImage> truth = ReadEdgedExr(path);
  if (!truth.ok()) return truth.status();
  absl::StatusOr<Reference> reference =
      MakeReference(std::filesystem::path(path).stem().string(), *std::move(truth));
  if (!reference.ok())
    return absl::Status(reference.status().code(), absl::StrCat(path, ": ", reference.status().message()));
  if (!reference->has_halves)
    std::fprintf(stderr, "%s: has no halves; its noise is part of the errors\n", path.c_str());
  return reference;
}

/// State shared by the charts of one run.
class Session {
 public:
  Session(const Options& options, RowStore* store, TaskPool* pool, std::vector<const Method*> methods)
      : options_(options),
        pool_(pool),
        methods_(methods),
        meter_({std::move(methods), options.again, options.most_grid_seconds, options.most_run_seconds,
                options.timed_runs},
               store, options.cache, pool) {}

  absl::Status Run() {
    for (const std::string& chart : options_.charts) {
      absl::Status status = chart == "errors"     ? ChartErrors()
                            : chart == "tables"   ? Tables()
                            : chart == "stages"   ? Stages()
                            : chart == "adaptive" ? Adaptive()
                            : chart == "plan"     ? Plan()
                            : chart == "flicker"  ? Flicker()
                            : chart == "knee"     ? Knee()
                                                  : Constants();
      if (!status.ok()) return status;
      std::fprintf(stderr, "wrote %s/%s.md\n", options_.output.c_str(), chart.c_str());
    }
    if (!is_drawn_) std::fprintf(stderr, "gnuplot is not installed: charts are kept as its scripts\n");
    return absl::OkStatus();
  }

 private:
  FilmSettings SettingsOf(int samples, uint64_t seed) const {
    return {options_.width, options_.height, static_cast<uint32_t>(samples), seed};
  }

  DrawFormat Format() const { return options_.png ? DrawFormat::kSvgAndPng : DrawFormat::kSvg; }

  int ReferenceSamplesOf(size_t scene) const {
    return options_.reference_samples[options_.reference_samples.size() == 1 ? 0 : scene];
  }

  absl::StatusOr<Reference> RenderReference(const FilmSource& source, size_t scene) {
    const FilmSettings settings = SettingsOf(ReferenceSamplesOf(scene), kReferenceSeed);
    absl::StatusOr<RenderedFilm> truth = source.Get(settings, pool_);
    if (!truth.ok()) return truth.status();
    return MakeReference(std::filesystem::path(source.PathOf(settings)).stem().string(),
                         std::move(truth->film));
  }

  absl::Status RenderFilm(const FilmSource& source, const std::string& scene, int samples, Subject* subject) {
    subject->scene = scene;
    subject->source = &source;
    subject->settings = SettingsOf(samples, options_.film_seed);
    absl::StatusOr<RenderedFilm> film = source.Get(subject->settings, pool_);
    if (!film.ok()) return film.status();
    subject->rendered = *std::move(film);
    return absl::OkStatus();
  }

  /// Appends the rows of a scene's films.
  absl::Status MeasureScene(size_t number, std::vector<Row>* rows) {
    const std::string& scene = options_.scenes[number];
    const absl::StatusOr<FilmSource> source = FilmSource::Create(scene, options_.cache);
    if (!source.ok()) return source.status();
    const absl::StatusOr<Reference> reference = RenderReference(*source, number);
    if (!reference.ok()) return reference.status();
    const absl::StatusOr<RenderRates> rates = source->Rates(options_.width, options_.height, pool_);
    if (!rates.ok()) return rates.status();
    truths_.push_back({scene, ReferenceSamplesOf(number), reference->noise});
    for (const int samples : options_.samples) {
      Subject subject;
      if (absl::Status status = RenderFilm(*source, scene, samples, &subject); !status.ok()) return status;
      absl::StatusOr<std::vector<Row>> measured = meter_.Measure(&subject, *reference);
      if (!measured.ok()) return measured.status();
      for (Row& row : *measured) {
        const Method& method = **std::find_if(methods_.begin(), methods_.end(), [&](const Method* candidate) {
          return candidate->info.name == row.method;
        });
        if (!method.renders) AddRendering(*rates, method.info, &row);
        rows->push_back(std::move(row));
      }
    }
    return absl::OkStatus();
  }

  absl::Status MeasurePair(const std::string& film_path, const std::string& reference_path,
                           std::vector<Row>* rows) {
    absl::StatusOr<EdgedImage> film = ReadEdgedExr(film_path);
    if (!film.ok()) return film.status();
    const absl::StatusOr<Reference> reference = ReadReference(reference_path);
    if (!reference.ok()) return reference.status();
    Subject subject;
    subject.scene = std::filesystem::path(film_path).stem().string();
    subject.settings = {film->pixels.width(), film->pixels.height(),
                        static_cast<uint32_t>(SamplesOf(film->pixels)), 0};
    subject.rendered.film = *std::move(film);
    const absl::StatusOr<std::vector<Row>> measured = meter_.Measure(&subject, *reference);
    if (!measured.ok()) return measured.status();
    rows->insert(rows->end(), measured->begin(), measured->end());
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<Row>> MeasureAll() {
    std::vector<Row> rows;
    truths_.clear();
    for (size_t i = 0; i < options_.scenes.size(); ++i) {
      if (const absl::Status status = MeasureScene(i, &rows); !status.ok()) return status;
    }
    for (size_t i = 0; i < options_.films.size(); ++i) {
      const absl::Status status = MeasurePair(options_.films[i], options_.references[i], &rows);
      if (!status.ok()) return status;
    }
    return rows;
  }

  absl::Status ChartErrors() {
    const absl::StatusOr<std::vector<Row>> rows = MeasureAll();
    if (!rows.ok()) return rows.status();
    const absl::StatusOr<bool> drawn =
        charts::ChartErrors(options_.output, *rows, truths_, {options_.command, options_.threads}, Format());
    if (!drawn.ok()) return drawn.status();
    is_drawn_ &= *drawn;
    std::printf("%s", RatioTable(*rows).c_str());
    return options_.quick ? CheckOrder(*rows) : absl::OkStatus();
  }

  absl::Status Tables() {
    const absl::StatusOr<std::vector<Row>> rows = MeasureAll();
    if (!rows.ok()) return rows.status();
    return WritePaperTables(options_.output, *rows, truths_, {options_.command, options_.threads});
  }

  absl::Status Stages() {
    std::vector<JobStages> jobs;
    for (const std::string& scene : options_.scenes) {
      const absl::StatusOr<FilmSource> source = FilmSource::Create(scene, options_.cache);
      if (!source.ok()) return source.status();
      absl::StatusOr<JobStages> job = MeasureStages(
          scene, *source, SettingsOf(options_.samples.back(), options_.film_seed), options_.cache, pool_);
      if (!job.ok()) return job.status();
      jobs.push_back(*std::move(job));
    }
    const absl::StatusOr<bool> drawn =
        ChartStages(options_.output, jobs, {options_.command, options_.threads}, Format());
    is_drawn_ &= drawn.value_or(false);
    return drawn.status();
  }

  /// Calls measure(film, reference) for each scene and sample count.
  absl::Status ForEachFilm(absl::FunctionRef<void(const Subject&, const Reference&)> measure) {
    for (size_t i = 0; i < options_.scenes.size(); ++i) {
      const absl::StatusOr<FilmSource> source = FilmSource::Create(options_.scenes[i], options_.cache);
      if (!source.ok()) return source.status();
      const absl::StatusOr<Reference> reference = RenderReference(*source, i);
      if (!reference.ok()) return reference.status();
      for (const int samples : options_.samples) {
        Subject subject;
        absl::Status status = RenderFilm(*source, options_.scenes[i], samples, &subject);
        if (!status.ok()) return status;
        measure(subject, *reference);
        std::fprintf(stderr, "%s, %d spp: measured\n", options_.scenes[i].c_str(), samples);
      }
    }
    return absl::OkStatus();
  }

  absl::Status Knee() {
    std::vector<KneePoint> points;
    absl::Status status = ForEachFilm([&](const Subject& subject, const Reference& reference) {
      const std::vector<KneePoint> more = MeasureKnee(subject, reference, pool_);
      points.insert(points.end(), more.begin(), more.end());
    });
    if (!status.ok()) return status;
    const absl::StatusOr<bool> drawn =
        ChartKnee(options_.output, points, {options_.command, options_.threads}, Format());
    is_drawn_ &= drawn.value_or(false);
    return drawn.status();
  }

  absl::Status Constants() {
    std::vector<ConstantPoint> points;
    absl::Status status = ForEachFilm([&](const Subject& subject, const Reference& reference) {
      const std::vector<ConstantPoint> more = MeasureConstants(subject, reference, pool_);
      points.insert(points.end(), more.begin(), more.end());
    });
    if (!status.ok()) return status;
    return WriteConstants(options_.output, points, {options_.command, options_.threads});
  }

  absl::Status Adaptive() {
    const Budgets budgets = {options_.uniform_samples.empty() ? options_.samples : options_.uniform_samples,
                             options_.samples};
    std::vector<AdaptivePoint> points;
    for (size_t i = 0; i < options_.scenes.size(); ++i) {
      const absl::StatusOr<FilmSource> source = FilmSource::Create(options_.scenes[i], options_.cache);
      if (!source.ok()) return source.status();
      const absl::StatusOr<Reference> reference = RenderReference(*source, i);
      if (!reference.ok()) return reference.status();
      const absl::StatusOr<std::vector<AdaptivePoint>> more = MeasureAdaptive(
          options_.scenes[i], *source, SettingsOf(1, options_.film_seed), budgets, *reference, pool_);
      if (!more.ok()) return more.status();
      points.insert(points.end(), more->begin(), more->end());
      std::fprintf(stderr, "%s: every budget rendered\n", options_.scenes[i].c_str());
    }
    const absl::StatusOr<bool> drawn =
        ChartAdaptive(options_.output, points, {options_.command, options_.threads}, Format());
    is_drawn_ &= drawn.value_or(false);
    return drawn.status();
  }

  absl::Status Plan() {
    const FilmSettings settings = SettingsOf(options_.samples.back(), options_.film_seed);
    std::vector<PlanPair> pairs;
    for (size_t i = 0; i < options_.scenes.size(); ++i) {
      const absl::StatusOr<FilmSource> source = FilmSource::Create(options_.scenes[i], options_.cache);
      if (!source.ok()) return source.status();
      const absl::StatusOr<Reference> reference = RenderReference(*source, i);
      if (!reference.ok()) return reference.status();
      const absl::StatusOr<std::vector<PlanPair>> more = MeasurePlan(
          options_.scenes[i], *source, settings, options_.seeds, *reference, options_.cache, pool_);
      if (!more.ok()) return more.status();
      pairs.insert(pairs.end(), more->begin(), more->end());
      std::fprintf(stderr, "%s: %d pairs\n", options_.scenes[i].c_str(), options_.seeds);
    }
    const absl::StatusOr<bool> drawn =
        ChartPlan(options_.output, pairs, settings, {options_.command, options_.threads}, Format());
    is_drawn_ &= drawn.value_or(false);
    return drawn.status();
  }

  absl::Status Flicker() {
    const FlickerSettings settings = {options_.width, options_.height, options_.samples.back(),
                                      options_.reference_samples.front(), options_.frames};
    std::vector<FrameChange> changes;
    for (const std::string& scene : options_.scenes) {
      const absl::StatusOr<std::vector<FrameChange>> more =
          MeasureFrames(scene, settings, options_.cache, pool_);
      if (!more.ok()) return more.status();
      changes.insert(changes.end(), more->begin(), more->end());
      std::fprintf(stderr, "%s: %d frames\n", scene.c_str(), options_.frames);
    }
    return ChartFlicker(options_.output, changes, settings, {options_.command, options_.threads});
  }

  const Options& options_;
  TaskPool* pool_;
  std::vector<const Method*> methods_;
  Meter meter_;
  std::vector<Truth> truths_;  // of the scenes measured last
  bool is_drawn_ = true;
};

}  // namespace

void MakeQuick(Options* options) {
  options->scenes = {"cornell-box", "meeting-room"};
  options->samples = {4, 16};
  options->reference_samples = {512};
  options->width = 128;
  options->height = 96;
  options->most_grid_seconds = 0.5;
  options->most_run_seconds = 2;
  options->timed_runs = 1;
}

absl::Status RunCharts(const Options& options) {
  for (const std::string& folder : {options.output, options.cache}) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) return absl::UnavailableError(absl::StrCat(folder, ": ", error.message()));
  }
  const absl::StatusOr<std::vector<const Method*>> methods = FindMethods(options.methods);
  if (!methods.ok()) return methods.status();
  if (absl::StatusOr<std::vector<const Method*>> again = FindMethods(options.again); !again.ok())
    return again.status();
  absl::StatusOr<RowStore> store = RowStore::Open(options.cache + "/rows.txt");
  if (!store.ok()) return store.status();
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(options.threads);
  return Session(options, &*store, pool.get(), *methods).Run();
}

}  // namespace lumifold::charts
