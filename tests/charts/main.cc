// Charts error against time and samples: renders films of the generated scenes, filters them by our methods
// and by every baseline (its default and each point of its grid), and judges them against a reference.
//
//   lumifold-chart --quick                                  a minute: two scenes, 128x96, sanity checks
//   lumifold-chart --scenes cornell-box,atrium --spp 4,16   films of one's choice
//   lumifold-chart --film a.exr --reference b.exr           a saved film against a file's noisy layer
//
// It writes charts.csv and, where gnuplot is, SVG charts into the output folder, and prints what our
// default's error is of each baseline's best. MSE255 is less the reference's own, known from its halves.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "filter/image/layers.h"
#include "tests/charts/film_source.h"
#include "tests/charts/measure.h"
#include "tests/charts/plot.h"
#include "tests/charts/report.h"

namespace lumifold::charts {
namespace {

// Exit codes; 0 is success.
constexpr int kFailure = 1;
constexpr int kUsageError = 2;

constexpr uint64_t kFilmSeed = 1;
constexpr uint64_t kReferenceSeed = 777;  // another one: noise in common would hide errors

struct Options {
  bool quick = false;
  std::vector<std::string> scenes;
  std::vector<int> samples = {4, 16, 64, 256};
  int reference_samples = 4096;
  int width = 256;
  int height = 192;
  std::vector<std::string> films;
  std::vector<std::string> references;
  std::string output = "lumifold-charts";
  std::string cache;
  int threads = 1;
};

void MakeQuick(Options* options) {
  options->scenes = {"cornell-box", "meeting-room"};
  options->samples = {4, 16};
  options->reference_samples = 512;
  options->width = 128;
  options->height = 96;
}

absl::Status MeasureScene(const Options& options, const std::string& scene, TaskPool* pool,
                          std::vector<Row>* rows) {
  const absl::StatusOr<FilmSource> source = FilmSource::Create(scene, options.cache);
  if (!source.ok()) return source.status();
  const auto settings = [&](int samples, uint64_t seed) {
    return FilmSettings{options.width, options.height, static_cast<uint32_t>(samples), seed};
  };
  absl::StatusOr<TimedFilm> truth = source->Get(settings(options.reference_samples, kReferenceSeed), pool);
  if (!truth.ok()) return truth.status();
  const absl::StatusOr<Reference> reference = MakeReference(std::move(truth->film));
  if (!reference.ok()) return reference.status();
  for (const int samples : options.samples) {
    absl::StatusOr<TimedFilm> film = source->Get(settings(samples, kFilmSeed), pool);
    if (!film.ok()) return film.status();
    const absl::StatusOr<std::vector<Row>> measured =
        Measure({scene, samples, *std::move(film)}, *reference, pool);
    if (!measured.ok()) return measured.status();
    rows->insert(rows->end(), measured->begin(), measured->end());
    std::fprintf(stderr, "%s, %d spp: %zu runs\n", scene.c_str(), samples, measured->size());
  }
  return absl::OkStatus();
}

/// The most samples any pixel has.
int SamplesOf(const LayeredImage& film) {
  float most = 0;
  if (!film.Has(layers::kSamplesA) || !film.Has(layers::kSamplesB)) return 0;
  const ConstFloatView a = film.Get(layers::kSamplesA);
  const ConstFloatView b = film.Get(layers::kSamplesB);
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) most = std::max(most, a.At(x, y) + b.At(x, y));
  }
  return static_cast<int>(most);
}

absl::Status MeasurePair(const std::string& film_path, const std::string& reference_path, TaskPool* pool,
                         std::vector<Row>* rows) {
  absl::StatusOr<EdgedImage> film = ReadEdgedExr(film_path);
  if (!film.ok()) return film.status();
  absl::StatusOr<EdgedImage> truth = ReadEdgedExr(reference_path);
  if (!truth.ok()) return truth.status();
  const absl::StatusOr<Reference> reference = MakeReference(*std::move(truth));
  if (!reference.ok())
    return absl::Status(reference.status().code(),
                        absl::StrCat(reference_path, ": ", reference.status().message()));
  if (!reference->has_halves)
    std::fprintf(stderr, "%s: has no halves; its noise is not taken off\n", reference_path.c_str());
  const int samples = SamplesOf(film->pixels);
  const std::string name = std::filesystem::path(film_path).stem().string();
  const absl::StatusOr<std::vector<Row>> measured =
      Measure({name, samples, {*std::move(film), 0}}, *reference, pool);
  if (!measured.ok()) return measured.status();
  rows->insert(rows->end(), measured->begin(), measured->end());
  std::fprintf(stderr, "%s, %d spp: %zu runs\n", name.c_str(), samples, measured->size());
  return absl::OkStatus();
}

absl::StatusOr<std::vector<Row>> MeasureAll(const Options& options, TaskPool* pool) {
  std::vector<Row> rows;
  for (const std::string& scene : options.scenes) {
    const absl::Status status = MeasureScene(options, scene, pool, &rows);
    if (!status.ok()) return status;
  }
  for (size_t i = 0; i < options.films.size(); ++i) {
    const absl::Status status = MeasurePair(options.films[i], options.references[i], pool, &rows);
    if (!status.ok()) return status;
  }
  return rows;
}

absl::Status Run(const Options& options) {
  std::error_code error;
  std::filesystem::create_directories(options.output, error);
  if (error) return absl::UnavailableError(absl::StrCat(options.output, ": ", error.message()));
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(options.threads);
  const absl::StatusOr<std::vector<Row>> rows = MeasureAll(options, pool.get());
  if (!rows.ok()) return rows.status();
  const std::string csv = options.output + "/charts.csv";
  if (const absl::Status status = WriteCsv(csv, *rows); !status.ok()) return status;
  const absl::StatusOr<bool> drawn = DrawCharts(options.output, *rows);
  if (!drawn.ok()) return drawn.status();
  std::fprintf(stderr,
               *drawn ? "wrote %s and its charts\n"
                      : "wrote %s and scripts of charts; there is no gnuplot here to draw them\n",
               csv.c_str());
  std::printf("%s", RatioTable(*rows).c_str());
  return options.quick ? CheckOrder(*rows) : absl::OkStatus();
}

int Main(int argc, char** argv) {
  Options options;
  options.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  CLI::App app(
      "Charts the error of every filter against time and samples.\n"
      "Exit codes: 0 done, 1 failed or, with --quick, out of order, 2 wrong usage.",
      "lumifold-chart");
  app.add_flag("--quick", options.quick, "Two scenes at 128x96, 4 and 16 spp, with sanity checks");
  app.add_option("--scenes", options.scenes, "Generated scenes, such as cornell-box,atrium")->delimiter(',');
  app.add_option("--spp", options.samples, "Sample counts (default 4,16,64,256)")
      ->delimiter(',')
      ->check(CLI::Range(1, 1 << 20));
  app.add_option("--reference-spp", options.reference_samples, "Samples of the reference (default 4096)")
      ->check(CLI::Range(1, 1 << 20));
  app.add_option("--width", options.width, "Pixels (default 256)")->check(CLI::Range(1, 16384));
  app.add_option("--height", options.height, "Pixels (default 192)")->check(CLI::Range(1, 16384));
  app.add_option("--film", options.films, "A film of --save-film; with a --reference each")
      ->allow_extra_args(false);
  app.add_option("--reference", options.references, "Its reference")->allow_extra_args(false);
  app.add_option("--output", options.output, "Folder for the results (default lumifold-charts)");
  app.add_option("--cache", options.cache, "Folder that keeps films (default OUTPUT/cache)");
  app.add_option("--threads", options.threads, "Threads (default: all)")->check(CLI::Range(1, 4096));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : kUsageError;
  }
  if (options.quick) MakeQuick(&options);
  if (options.films.size() != options.references.size() ||
      (options.scenes.empty() && options.films.empty())) {
    std::fprintf(stderr, "lumifold-chart: give --quick, --scenes, or as many --film as --reference\n");
    return kUsageError;
  }
  if (options.cache.empty()) options.cache = options.output + "/cache";
  const absl::Status status = Run(options);
  if (status.ok()) return 0;
  std::fprintf(stderr, "lumifold-chart: %s\n", std::string(status.message()).c_str());
  return kFailure;
}

}  // namespace
}  // namespace lumifold::charts

int main(int argc, char** argv) { return lumifold::charts::Main(argc, argv); }
