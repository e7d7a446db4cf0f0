#include "tests/charts/film_source.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "filter/image/exr_io.h"
#include "proto/rpc/checksum.h"
#include "server/film/film_builder.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::charts {
namespace {

constexpr uint32_t kPassSamples = 64;
constexpr char kSecondsKey[] = "lumifold.chart.render_seconds";

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
  EdgedImage geometry = renderer.RenderGeometry(rect, 0);
  film->SetGeometry(rect, geometry.pixels);
  film->AddEdges(std::move(geometry.edges));
}

}  // namespace

FilmSource::FilmSource(std::string name, std::string bytes, std::string cache_folder)
    : name_(std::move(name)), bytes_(std::move(bytes)), cache_folder_(std::move(cache_folder)) {}

absl::StatusOr<FilmSource> FilmSource::Create(const std::string& scene_name,
                                              const std::string& cache_folder) {
  const scenes::SceneEntry* entry = scenes::FindScene(scene_name);
  if (entry == nullptr) return absl::NotFoundError(absl::StrCat("no scene is named '", scene_name, "'"));
  return Create(entry->build(), cache_folder);
}

absl::StatusOr<FilmSource> FilmSource::Create(const scenes::SceneDescription& scene,
                                              const std::string& cache_folder) {
  absl::StatusOr<std::string> bytes = scenes::EncodeGlb(scene);
  if (!bytes.ok()) return bytes.status();
  std::error_code error;
  std::filesystem::create_directories(cache_folder, error);
  if (error) return absl::UnavailableError(absl::StrCat(cache_folder, ": ", error.message()));
  return FilmSource(scene.name, *std::move(bytes), cache_folder);
}

std::string FilmSource::PathOf(const FilmSettings& settings) const {
  const std::string key =
      absl::StrCat(rpc::Checksum(bytes_), " ", render::NumericClass(), " ", settings.seed);
  return absl::StrFormat("%s/%s-%dx%d-%d-%016x.exr", cache_folder_, name_, settings.width, settings.height,
                         settings.samples, rpc::Checksum(key));
}

absl::StatusOr<TimedFilm> FilmSource::Get(const FilmSettings& settings, TaskPool* pool) const {
  const std::string path = PathOf(settings);
  absl::StatusOr<EdgedImage> cached = ReadEdgedExr(path);
  if (cached.ok()) {
    TimedFilm timed{*std::move(cached), 0};
    const auto seconds = timed.film.pixels.metadata().find(kSecondsKey);
    if (seconds != timed.film.pixels.metadata().end() &&
        absl::SimpleAtod(seconds->second, &timed.render_seconds)) {
      return timed;
    }
    return absl::DataLossError(absl::StrCat(path, ": is no film of a chart's cache"));
  }
  if (!absl::IsNotFound(cached.status())) return cached.status();
  absl::StatusOr<TimedFilm> timed = Render(settings, pool);
  if (!timed.ok()) return timed.status();
  timed->film.pixels.metadata()[kSecondsKey] = absl::StrCat(timed->render_seconds);
  if (const absl::Status status = WriteExr(path, timed->film); !status.ok()) return status;
  return timed;
}

absl::StatusOr<std::unique_ptr<render::Renderer>> FilmSource::MakeRenderer(
    const FilmSettings& settings) const {
  const auto no_files = [](const std::string& uri) {
    return absl::NotFoundError(absl::StrCat("a generated scene has no file '", uri, "'"));
  };
  absl::StatusOr<scene::Scene> scene = scene::LoadGltf(bytes_, name_, no_files);
  if (!scene.ok()) return scene.status();
  render::RenderSettings render_settings;
  render_settings.width = settings.width;
  render_settings.height = settings.height;
  render_settings.seed = settings.seed;
  return render::Renderer::Create(std::make_shared<const scene::Scene>(*std::move(scene)), render_settings);
}

absl::StatusOr<TimedFilm> FilmSource::Render(const FilmSettings& settings, TaskPool* pool) const {
  const absl::StatusOr<std::unique_ptr<render::Renderer>> renderer = MakeRenderer(settings);
  if (!renderer.ok()) return renderer.status();
  const absl::Time start = absl::Now();
  EdgedImage film = RenderFilm(**renderer, settings, {}, pool);
  return TimedFilm{std::move(film), absl::ToDoubleSeconds(absl::Now() - start)};
}

EdgedImage RenderFilm(const render::Renderer& renderer, const FilmSettings& settings, TileSize tile,
                      TaskPool* pool) {
  film::FilmBuilder film(settings.width, settings.height);
  const std::vector<Rect> tiles = TilesOf(settings, tile);
  ParallelFor(pool, static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    RenderTile(renderer, tiles[static_cast<size_t>(i)], settings.samples, &film);
  });
  return film.Take();
}

}  // namespace lumifold::charts
