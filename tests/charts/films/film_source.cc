#include "tests/charts/films/film_source.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "filter/image/picture_io.h"
#include "proto/rpc/checksum.h"
#include "server/film/film_builder.h"
#include "tests/charts/access/charts_access.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "tests/support/cpu_seconds.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::charts {
namespace {

constexpr uint32_t kPassSamples = 64;
constexpr char kSecondsKey[] = "lumifold.chart.render_seconds";

absl::Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  return absl::OkStatus();
}

/// The frame's tiles, row by row.
std::vector<Rect> TilesOf(const FilmSettings& settings, TileSize tile) {
  std::vector<Rect> tiles;
  for (int y = 0; y < settings.height; y += tile.height) {
    for (int x = 0; x < settings.width; x += tile.width)
      tiles.push_back(
          {x, y, std::min(x + tile.width, settings.width), std::min(y + tile.height, settings.height)});
  }
  return tiles;
}

void RenderTile(const render::Renderer& renderer, const Rect& rect, uint32_t samples,
                film::FilmBuilder* film) {
  film::TileSums sums;
  render::RenderCounts counts;
  for (uint32_t first = 0; first < samples; first += kPassSamples)
    sums.Add(renderer.RenderPass(rect, 0, {first, std::min(first + kPassSamples, samples)}, &counts));
  film->SetMeans(rect, sums);
  const EdgedImage geometry = renderer.RenderGeometry(rect, 0);
  film->SetGeometry(rect, geometry.pixels);
  film->AddEdges(geometry.edges);
}

}  // namespace

FilmSource::FilmSource(std::string name, std::string bytes, std::string cache_folder)
    : name_(std::move(name)), bytes_(std::move(bytes)), cache_folder_(std::move(cache_folder)) {}

absl::StatusOr<FilmSource> FilmSource::Create(const std::string& scene_name,
                                              const std::string& cache_folder) {
  for (const LensScene& seen : kLensScenes) {
    if (seen.name != scene_name) continue;
    absl::StatusOr<FilmSource> source = Create(std::string(seen.scene), cache_folder);
    if (!source.ok()) return source;
    source->name_ = scene_name;
    source->lens_ = seen.lens;
    return source;
  }
  const scenes::SceneEntry* entry = scenes::FindScene(scene_name);
  if (entry == nullptr) return CreateFromFile(scene_name, cache_folder);
  return Create(entry->build(), cache_folder);
}

absl::StatusOr<FilmSource> FilmSource::Create(const scenes::SceneDescription& scene,
                                              const std::string& cache_folder) {
  absl::StatusOr<std::string> bytes = scenes::EncodeGlb(scene);
  if (!bytes.ok()) return bytes.status();
  if (absl::Status status = MakeFolder(cache_folder); !status.ok()) return status;
  return FilmSource(scene.name, *std::move(bytes), cache_folder);
}

absl::StatusOr<FilmSource> FilmSource::CreateFromFile(const std::string& name,
                                                      const std::string& cache_folder) {
  constexpr int64_t kMostBytes = int64_t{1} << 32;
  const char* folder = std::getenv("LUMIFOLD_SCENES_DIR");
  if (folder == nullptr) {
    return absl::NotFoundError(
        absl::StrCat("no scene is named '", name, "', and LUMIFOLD_SCENES_DIR is not set to look there"));
  }
  absl::StatusOr<std::string> bytes = ReadFile(absl::StrCat(folder, "/", name, ".glb"), kMostBytes);
  if (!bytes.ok()) return bytes.status();
  if (absl::Status status = MakeFolder(cache_folder); !status.ok()) return status;
  FilmSource source(name, *std::move(bytes), cache_folder);
  const std::string sky_path = absl::StrCat(folder, "/", name, "-sky.exr");
  absl::StatusOr<std::string> sky = ReadFile(sky_path, kMostBytes);
  if (absl::IsNotFound(sky.status())) return source;
  if (!sky.ok()) return sky.status();
  const absl::StatusOr<LayeredImage> picture = DecodeLinearPicture(sky_path, *sky);
  if (!picture.ok()) return picture.status();
  absl::StatusOr<std::shared_ptr<const render::Environment>> environment =
      render::Environment::Create(*picture, 0, 1);
  if (!environment.ok()) return environment.status();
  source.sky_ = *std::move(environment);
  source.sky_bytes_ = *std::move(sky);
  return source;
}

std::string FilmSource::HashOf(uint64_t seed) const {
  std::string key = absl::StrCat(rpc::Checksum(bytes_), " ", render::NumericClass(), " ", seed);
  if (lens_.f_stop > 0) absl::StrAppend(&key, " ", lens_.f_stop, " ", lens_.focus_metres);
  if (sky_ != nullptr) absl::StrAppend(&key, " ", rpc::Checksum(sky_bytes_));
  return absl::StrFormat("%016x", rpc::Checksum(key));
}

std::string FilmSource::PathOf(const FilmSettings& settings) const {
  return absl::StrFormat("%s/%s-%dx%d-%d-%s.exr", cache_folder_, name_, settings.width, settings.height,
                         settings.samples, HashOf(settings.seed));
}

absl::StatusOr<RenderedFilm> FilmSource::Get(const FilmSettings& settings, TaskPool* pool) const {
  const std::string path = PathOf(settings);
  absl::StatusOr<EdgedImage> cached = ReadEdgedExr(path);
  if (cached.ok()) {
    RenderedFilm rendered{*std::move(cached), 0};
    const auto seconds = rendered.film.pixels.metadata().find(kSecondsKey);
    if (seconds != rendered.film.pixels.metadata().end() &&
        absl::SimpleAtod(seconds->second, &rendered.render_seconds)) {
      return rendered;
    }
    return absl::DataLossError(absl::StrCat(path, ": not a film of a chart cache"));
  }
  if (!absl::IsNotFound(cached.status())) return cached.status();
  absl::StatusOr<RenderedFilm> rendered = Render(settings, pool);
  if (!rendered.ok()) return rendered.status();
  rendered->film.pixels.metadata()[kSecondsKey] = absl::StrCat(rendered->render_seconds);
  if (const absl::Status status = WriteExr(path, rendered->film); !status.ok()) return status;
  return rendered;
}

absl::StatusOr<std::shared_ptr<const scene::Scene>> FilmSource::LoadScene() const {
  const auto no_files = [this](const std::string& uri) {
    return absl::NotFoundError(absl::StrCat(name_, " refers to a file '", uri, "': charts read only .glb"));
  };
  absl::StatusOr<scene::Scene> scene = scene::LoadGltf(bytes_, name_, no_files);
  if (!scene.ok()) return scene.status();
  return std::make_shared<const scene::Scene>(*std::move(scene));
}

render::RenderSettings FilmSource::SettingsFor(const FilmSettings& settings) const {
  render::RenderSettings render_settings;
  render_settings.width = settings.width;
  render_settings.height = settings.height;
  render_settings.seed = settings.seed;
  render_settings.environment = sky_;
  render_settings.lens = lens_;
  return render_settings;
}

absl::StatusOr<std::unique_ptr<render::Renderer>> FilmSource::MakeRenderer(
    const FilmSettings& settings) const {
  absl::StatusOr<std::shared_ptr<const scene::Scene>> scene = LoadScene();
  if (!scene.ok()) return scene.status();
  return render::Renderer::Create(*std::move(scene), SettingsFor(settings));
}

absl::StatusOr<RenderedFilm> FilmSource::Render(const FilmSettings& settings, TaskPool* pool) const {
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = MakeRenderer(settings);
  if (!renderer.ok()) return renderer.status();
  const absl::Time start = absl::Now();
  EdgedImage film = RenderFilm(**renderer, settings, {}, pool);
  return RenderedFilm{std::move(film), absl::ToDoubleSeconds(absl::Now() - start)};
}

EdgedImage RenderFilm(const render::Renderer& renderer, const FilmSettings& settings, TileSize tile,
                      TaskPool* pool) {
  film::UnitModel model;
  model.carried.lens = renderer.camera().HasLens();
  film::FilmBuilder film(settings.width, settings.height, model);
  const std::vector<Rect> tiles = TilesOf(settings, tile);
  ParallelFor(pool, static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    RenderTile(renderer, tiles[static_cast<size_t>(i)], settings.samples, &film);
  });
  return film.Take();
}

absl::StatusOr<RenderRates> FilmSource::Rates(int width, int height, TaskPool* pool) const {
  const std::string path =
      absl::StrFormat("%s/%s-%dx%d-rates-%s.txt", cache_folder_, name_, width, height, HashOf(0));
  const absl::StatusOr<std::string> kept = ReadFile(path, 1 << 10);
  RenderRates rates;
  if (kept.ok()) {
    const std::vector<std::string> numbers = absl::StrSplit(*kept, ' ');
    if (numbers.size() == 3 && absl::SimpleAtod(numbers[0], &rates.radiance) &&
        absl::SimpleAtod(numbers[1], &rates.layered) && absl::SimpleAtod(numbers[2], &rates.geometry)) {
      return rates;
    }
    return absl::DataLossError(absl::StrCat(path, ": not the rates of a chart cache"));
  }
  if (!absl::IsNotFound(kept.status())) return kept.status();
  absl::StatusOr<RenderRates> measured = MeasureRates(width, height, pool);
  if (!measured.ok()) return measured.status();
  const absl::Status written = WriteFileAtomically(
      path, absl::StrCat(measured->radiance, " ", measured->layered, " ", measured->geometry));
  if (!written.ok()) return written;
  return measured;
}

absl::StatusOr<RenderRates> FilmSource::MeasureRates(int width, int height, TaskPool* pool) const {
  constexpr int kRounds = 3;
  constexpr uint32_t kSamples = 16;
  const absl::StatusOr<std::shared_ptr<const scene::Scene>> scene = LoadScene();
  if (!scene.ok()) return scene.status();
  const FilmSettings settings = {width, height, kSamples, 0};
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
      render::Renderer::Create(*scene, SettingsFor(settings));
  if (!renderer.ok()) return renderer.status();
  const std::vector<Rect> tiles = TilesOf(settings, {});
  const auto seconds_of = [&](auto task) {
    const double start = CpuSeconds();
    ParallelFor(pool, static_cast<int64_t>(tiles.size()),
                [&](int64_t i) { task(tiles[static_cast<size_t>(i)]); });
    return CpuSeconds() - start;
  };
  const auto layered = [&](const Rect& tile) {
    render::RenderCounts counted;
    (*renderer)->RenderPass(tile, 0, {0, kSamples}, &counted);
  };
  const auto radiance = [&](const Rect& tile) {
    render::RenderCounts counted;
    render::ChartsAccess(**renderer).RenderRadiance(tile, 0, {0, kSamples}, &counted);
  };
  const auto geometry = [&](const Rect& tile) { (*renderer)->RenderGeometry(tile, 0); };
  constexpr double kLong = std::numeric_limits<double>::max();
  RenderRates rates = {kLong, kLong, kLong};
  for (int round = 0; round < kRounds; ++round) {
    rates.layered = std::min(rates.layered, seconds_of(layered) / kSamples);
    rates.radiance = std::min(rates.radiance, seconds_of(radiance) / kSamples);
    rates.geometry = std::min(rates.geometry, seconds_of(geometry));
  }
  return rates;
}

}  // namespace lumifold::charts
