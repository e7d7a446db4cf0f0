#include "tests/charts/stages.h"

#include <array>
#include <atomic>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/denoise/denoise.h"
#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "server/film/film_builder.h"
#include "server/film/result.h"
#include "tests/charts/figure.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

constexpr int kTile = 32;
constexpr uint32_t kPassSamples = 64;

int64_t BytesOf(const LayeredImage& image) {
  return static_cast<int64_t>(image.channels().size() * sizeof(float)) * image.width() * image.height();
}

/// What is rendered of one tile.
struct TileUnits {
  Rect rect;
  std::vector<EdgedImage> passes;
  EdgedImage geometry;
};

std::vector<TileUnits> CutFrame(const FilmSettings& settings) {
  std::vector<TileUnits> tiles;
  for (int y = 0; y < settings.height; y += kTile) {
    for (int x = 0; x < settings.width; x += kTile) {
      tiles.emplace_back().rect = {x, y, std::min(x + kTile, settings.width),
                                   std::min(y + kTile, settings.height)};
    }
  }
  return tiles;
}

/// Appends a stage that runs `task` and hands on `bytes()`.
template <typename Task, typename Bytes>
void AddStage(const std::string& name, std::vector<Stage>* stages, Task task, Bytes bytes) {
  const double start = CpuSeconds();
  task();
  const double seconds = CpuSeconds() - start;
  stages->push_back({name, seconds, bytes()});
}

void RenderStages(const render::Renderer& renderer, uint32_t samples, TaskPool* pool,
                  std::vector<TileUnits>* tiles, std::vector<Stage>* stages) {
  const auto count = static_cast<int64_t>(tiles->size());
  AddStage(
      "passes", stages,
      [&] {
        ParallelFor(pool, count, [&](int64_t i) {
          TileUnits& tile = (*tiles)[static_cast<size_t>(i)];
          render::RenderCounts counts;
          for (uint32_t first = 0; first < samples; first += kPassSamples) {
            tile.passes.push_back(
                renderer.RenderPass(tile.rect, 0, {first, std::min(first + kPassSamples, samples)}, &counts));
          }
        });
      },
      [&] {
        int64_t bytes = 0;
        for (const TileUnits& tile : *tiles) {
          for (const EdgedImage& pass : tile.passes) bytes += BytesOf(pass.pixels) + BytesOf(pass.fragments);
        }
        return bytes;
      });
  AddStage(
      "geometry units", stages,
      [&] {
        ParallelFor(pool, count, [&](int64_t i) {
          TileUnits& tile = (*tiles)[static_cast<size_t>(i)];
          tile.geometry = renderer.RenderGeometry(tile.rect, 0);
        });
      },
      [&] {
        int64_t bytes = 0;
        for (const TileUnits& tile : *tiles)
          bytes += BytesOf(tile.geometry.pixels) + BytesOf(tile.geometry.edges);
        return bytes;
      });
}

EdgedImage AssemblyStage(const FilmSettings& settings, std::vector<TileUnits> tiles, TaskPool* pool,
                         std::vector<Stage>* stages) {
  EdgedImage film;
  AddStage(
      "assembly", stages,
      [&] {
        film::FilmBuilder builder(settings.width, settings.height);
        ParallelFor(pool, static_cast<int64_t>(tiles.size()), [&](int64_t i) {
          TileUnits& tile = tiles[static_cast<size_t>(i)];
          film::TileSums sums;
          for (const EdgedImage& pass : tile.passes) sums.Add(pass);
          builder.SetMeans(tile.rect, sums);
          builder.SetGeometry(tile.rect, tile.geometry.pixels);
          builder.AddEdges(tile.geometry.edges);
        });
        film = builder.Take();
      },
      [&] { return BytesOf(film.pixels) + BytesOf(film.edges) + BytesOf(film.fragments); });
  return film;
}

/// The default method once more, timed stage by stage; the stages of layers are summed over all layers.
std::vector<Stage> FilterStages(const EdgedImage& film, TaskPool* pool) {
  std::vector<Stage> stages;
  for (const filter::StageInfo& info : filter::Stages()) stages.push_back({std::string(info.name), 0, 0});
  double last = CpuSeconds();
  filter::DenoiseOptions options;
  options.watch = [&](std::string_view name) {
    const double now = CpuSeconds();
    for (Stage& stage : stages) {
      if (stage.name == name) stage.seconds += now - last;
    }
    last = now;
  };
  filter::Denoise(filter::Frame(film), pool, options);
  return stages;
}

absl::Status WriteStage(const FilmSettings& settings, EdgedImage film, std::array<Plane, 3> picture,
                        const std::string& scratch, std::vector<Stage>* stages) {
  film::ResultInfo info;
  info.spec.set_width(settings.width);
  info.spec.set_height(settings.height);
  info.numeric_class = render::NumericClass();
  const std::string path = scratch + "/stages.exr";
  absl::Status status;
  AddStage(
      "write", stages,
      [&] { status = WriteExr(path, film::BuildResult(std::move(film), std::move(picture), info)); },
      [&] {
        std::error_code error;
        return static_cast<int64_t>(std::filesystem::file_size(path, error));
      });
  std::error_code error;
  std::filesystem::remove(path, error);
  return status;
}

std::string Megabytes(int64_t bytes) {
  return bytes > 0 ? absl::StrFormat("%.2f", static_cast<double>(bytes) / 1e6) : "";
}

double SumOf(const std::vector<Stage>& stages) {
  double sum = 0;
  for (const Stage& stage : stages) sum += stage.seconds;
  return sum;
}

std::vector<Stacks::Part> PartsOf(const std::vector<Stage>& stages) {
  std::vector<Stacks::Part> parts;
  parts.reserve(stages.size());
  for (const Stage& stage : stages) parts.push_back({stage.name, 100 * stage.seconds / SumOf(stages)});
  return parts;
}

}  // namespace

absl::StatusOr<JobStages> MeasureStages(const std::string& scene, const FilmSource& source,
                                        const FilmSettings& settings, const std::string& scratch,
                                        TaskPool* pool) {
  JobStages stages{scene, settings, {}, {}};
  std::unique_ptr<render::Renderer> renderer;
  absl::Status status;
  AddStage(
      "scene and its tree", &stages.job,
      [&] {
        const absl::StatusOr<std::shared_ptr<const scene::Scene>> loaded = source.LoadScene();
        status = loaded.status();
        if (!status.ok()) return;
        absl::StatusOr<std::unique_ptr<render::Renderer>> made =
            render::Renderer::Create(*loaded, source.SettingsFor(settings));
        status = made.status();
        if (status.ok()) renderer = *std::move(made);
      },
      [] { return int64_t{0}; });
  if (!status.ok()) return status;
  std::vector<TileUnits> tiles = CutFrame(settings);
  RenderStages(*renderer, settings.samples, pool, &tiles, &stages.job);
  EdgedImage film = AssemblyStage(settings, std::move(tiles), pool, &stages.job);
  std::array<Plane, 3> picture;
  AddStage(
      "filter", &stages.job, [&] { picture = filter::Denoise(filter::Frame(film), pool); },
      [&] { return int64_t{3} * static_cast<int64_t>(sizeof(float)) * settings.width * settings.height; });
  stages.filter = FilterStages(film, pool);
  status = WriteStage(settings, std::move(film), std::move(picture), scratch, &stages.job);
  if (!status.ok()) return status;
  return stages;
}

absl::StatusOr<bool> ChartStages(const std::string& folder, const std::vector<JobStages>& jobs,
                                 const Provenance& provenance, DrawFormat format) {
  Stacks stacks{"Where the processor time of one job goes", {}, {}};
  std::string csv = "scene,width,height,spp,of,stage,processor_seconds,bytes\n";
  std::string text =
      TableHead({"scene", "size", "spp", "of", "stage", "processor seconds", "%", "MB handed on"});
  for (const JobStages& job : jobs) {
    const std::string size = absl::StrCat(job.settings.width, "x", job.settings.height);
    for (const auto& [of, stages] : {std::pair("job", &job.job), std::pair("filter", &job.filter)}) {
      stacks.columns.push_back(absl::StrCat(job.scene, ": ", of));
      stacks.parts.push_back(PartsOf(*stages));
      for (const Stage& stage : *stages) {
        absl::StrAppendFormat(&csv, "%s,%d,%d,%d,%s,%s,%.4f,%d\n", job.scene, job.settings.width,
                              job.settings.height, job.settings.samples, of,
                              absl::StrCat("\"", stage.name, "\""), stage.seconds, stage.bytes);
        absl::StrAppend(&text, TableLine({job.scene, size, absl::StrCat(job.settings.samples), of, stage.name,
                                          absl::StrFormat("%.3f", stage.seconds),
                                          absl::StrFormat("%.2f", 100 * stage.seconds / SumOf(*stages)),
                                          Megabytes(stage.bytes)}));
      }
    }
  }
  absl::StatusOr<bool> drawn = Draw(folder + "/stages", stacks, format);
  if (!drawn.ok()) return drawn;
  if (const absl::Status status = WriteFileAtomically(folder + "/stages.csv", csv); !status.ok())
    return status;
  const absl::Status status = WritePage(
      folder + "/stages.md", "Where time and bytes go", provenance,
      absl::StrCat(
          "Processor seconds of all threads together, with the farm's own libraries in one process; units "
          "are tiles of 32x32 pixels and passes of 64 samples, their bytes what workers would send before "
          "compression. The filter's parts are of a second run.\n\n![stages](stages.svg)\n\n",
          text));
  if (!status.ok()) return status;
  return drawn;
}

}  // namespace lumifold::charts
