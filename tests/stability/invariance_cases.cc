// Changes that must not affect a picture: tile size, threads, the unit of light, mirroring.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "tests/charts/metrics/seam.h"
#include "tests/stability/case.h"
#include "tests/stability/drawings.h"
#include "tests/stability/test_scenes.h"
#include "tests/support/shuffling_pool.h"

namespace lumifold::stability {
namespace {

using Figures = std::vector<double>;

bool Everywhere(int, int) { return true; }

absl::StatusOr<Finding> Tiles(const Trial& trial) {
  const scenes::SceneDescription scene = MirrorRoom();
  const charts::FilmSettings settings = {.width = 67, .height = 45, .samples = 8, .seed = 1};
  absl::StatusOr<SceneFilm> whole = trial.films.Get(scene, settings, trial.pool);
  if (!whole.ok()) return whole.status();
  absl::StatusOr<Picture> expected = trial.Filter(whole->subject());
  if (!expected.ok()) return expected.status();
  int different = 0;
  for (const charts::TileSize tile : {charts::TileSize{64, 64}, {7, 3}, {1, 1}}) {
    const absl::StatusOr<EdgedImage> cut = trial.films.RenderInTiles(scene, settings, tile, trial.pool);
    if (!cut.ok()) return cut.status();
    const absl::StatusOr<Picture> picture = trial.Filter({*cut, whole->source.get(), settings});
    if (!picture.ok()) return picture.status();
    different += CountDifferent(ViewOf(*picture), ViewOf(*expected));
  }
  Finding finding;
  finding.figures = {static_cast<double>(different)};
  const ConstColorView noisy = std::as_const(whole->film.pixels).GetColor(layers::kNoisy);
  finding.exhibit = {ClonePicture(noisy), ClonePicture(ViewOf(*expected)), *std::move(expected)};
  return finding;
}

/// A film whose square tiles have seeds and sample counts of their own.
DrawnFilm DrawInTiles(int width, int height, int tile) {
  DrawnFilm patchwork;
  for (uint32_t kind = 0; kind < 4; ++kind) {
    const uint32_t samples = kind == 0 || kind == 3 ? 8 : 32;  // as the squares of a chequer
    DrawnFilm other =
        DrawFilm(width, height, RoomDrawing(width, height), {.samples = samples, .seed = kind + 1});
    if (kind == 0) {
      patchwork = std::move(other);
      continue;
    }
    for (LayeredImage::Channel& channel : patchwork.film.pixels.channels()) {
      const ConstFloatView from = other.film.pixels.Get(channel.name);
      ForEachPixel(width, height, [&](int x, int y) {
        if (static_cast<uint32_t>(x / tile % 2 + 2 * (y / tile % 2)) == kind)
          channel.plane.At(x, y) = from.At(x, y);
      });
    }
  }
  return patchwork;
}

absl::StatusOr<Finding> Seams(const Trial& trial) {
  constexpr int kWidth = 192, kHeight = 128, kTile = 32, kCore = 64;
  const DrawnFilm drawn = DrawInTiles(kWidth, kHeight, kTile);
  const absl::StatusOr<Picture> as_one = trial.FilterInBlocks(drawn.film, {});
  if (!as_one.ok()) return as_one.status();
  filter::BlockParams small;
  small.core = kCore;
  small.whole = 0;
  const absl::StatusOr<Picture> in_blocks = trial.FilterInBlocks(drawn.film, small);
  if (!in_blocks.ok()) return in_blocks.status();
  return Judge(trial, drawn, [&](const Views& v) {
    const double error = DisplayError(v.filtered, v.truth, Everywhere);
    return Figures{
        static_cast<double>(CountDifferent(ViewOf(*as_one), v.filtered)),
        metrics::SeamIndex(v.filtered, v.truth, kTile) / metrics::SeamIndex(v.noisy, v.truth, kTile),
        metrics::SeamIndex(ViewOf(*in_blocks), v.filtered, kCore),
        DisplayError(ViewOf(*in_blocks), v.truth, Everywhere) / error};
  });
}

absl::StatusOr<Finding> Threads(const Trial& trial) {
  const DrawnFilm drawn = DrawFilm(131, 97, RoomDrawing(131, 97), {});
  return Judge(trial, drawn, [&](const Views& v) {
    std::vector<std::unique_ptr<TaskPool>> pools;
    for (const int threads : {1, 2, 3, 16}) pools.push_back(MakeTaskPool(threads));
    pools.push_back(std::make_unique<ShufflingPool>(7));
    pools.push_back(nullptr);
    int different = 0;
    for (const std::unique_ptr<TaskPool>& pool : pools) {
      const absl::StatusOr<Picture> picture = trial.FilterOn(pool.get(), {drawn.film});
      different += picture.ok() ? CountDifferent(ViewOf(*picture), v.filtered) : 131 * 97;
    }
    return Figures{static_cast<double>(different)};
  });
}

void MultiplyLight(float factor, LayeredImage* image) {
  for (LayeredImage::Channel& channel : image->channels()) {
    const auto is_of = [&](std::string_view layer) { return channel.name.starts_with(layer); };
    if (!std::any_of(layers::kHalved.begin(), layers::kHalved.end(), is_of) && !is_of(layers::kEmission))
      continue;
    ForEachPixel(image->width(), image->height(), [&](int x, int y) { channel.plane.At(x, y) *= factor; });
  }
}

Picture Times(float factor, const ConstColorView& color) {
  Picture product = ClonePicture(color);
  for (Plane& plane : product) {
    ForEachPixel(plane.width(), plane.height(), [&](int x, int y) { plane.At(x, y) *= factor; });
  }
  return product;
}

/// Difference between the pictures of a film in two units of light.
absl::StatusOr<double> DifferenceInUnit(const Trial& trial, float unit, const ConstColorView& expected) {
  DrawnFilm drawn = DrawFilm(128, 96, RoomDrawing(128, 96), {});
  MultiplyLight(unit, &drawn.film.pixels);
  MultiplyLight(unit, &drawn.film.edges);
  const absl::StatusOr<Picture> picture = trial.Filter({drawn.film});
  if (!picture.ok()) return picture.status();
  return LargestRelativeDifference(ViewOf(Times(1 / unit, ViewOf(*picture))), expected, Everywhere);
}

absl::StatusOr<Finding> DarkRoom(const Trial& trial) {
  const DrawnFilm drawn = DrawFilm(128, 96, RoomDrawing(128, 96), {});
  absl::StatusOr<Finding> finding = Judge(trial, drawn, [](const Views&) { return Figures(); });
  if (!finding.ok()) return finding.status();
  finding->figures = {0, 0};
  for (const float unit : {0x1p-20f, 1e-6f, 0.3f, 7.0f, 1000.0f}) {
    const absl::StatusOr<double> difference =
        DifferenceInUnit(trial, unit, ViewOf(finding->exhibit.filtered));
    if (!difference.ok()) return difference.status();
    double& figure = finding->figures[unit == 0x1p-20f ? 0 : 1];
    figure = std::max(figure, *difference);
  }
  return finding;
}

/// Mirrors a film horizontally: pixels, normals, and sub-samples inside their pixels.
void Mirror(Plane* plane) {
  for (int y = 0; y < plane->height(); ++y) std::reverse(plane->Row(y), plane->Row(y) + plane->width());
}

void MirrorFilm(EdgedImage* film) {
  for (LayeredImage::Channel& channel : film->pixels.channels()) Mirror(&channel.plane);
  LayeredImage& edges = film->edges;
  const int width = film->pixels.width();
  for (LayeredImage::Channel& channel : edges.channels()) {
    for (int row = 0; row < edges.height(); ++row) {
      float* values = channel.plane.Row(row);
      for (int j = 0; j < kSubSamples; j += 4) std::reverse(values + j, values + j + 4);
    }
  }
  for (LayeredImage* image : {&film->pixels, &edges}) {
    if (!image->Has(layers::kNormalX)) continue;
    const FloatView normal = image->Get(layers::kNormalX);
    ForEachPixel(image->width(), image->height(), [&](int x, int y) { normal.At(x, y) = -normal.At(x, y); });
  }
  if (edges.height() == 0) return;
  const FloatView place = edges.Get(layers::kPixelX);
  for (int row = 0; row < edges.height(); ++row) {
    for (int j = 0; j < kSubSamples; ++j) place.At(j, row) = static_cast<float>(width - 1) - place.At(j, row);
  }
}

absl::StatusOr<Finding> Mirrored(const Trial& trial) {
  constexpr int kSize = 128;
  const DrawnFilm drawn = DrawFilm(kSize, kSize, RoomDrawing(kSize, kSize), {});
  DrawnFilm other = DrawFilm(kSize, kSize, RoomDrawing(kSize, kSize), {});
  MirrorFilm(&other.film);
  absl::StatusOr<Picture> mirrored = trial.Filter({other.film});
  if (!mirrored.ok()) return mirrored.status();
  for (Plane& plane : *mirrored) Mirror(&plane);
  return Judge(trial, drawn, [&](const Views& v) {
    return Figures{DisplayError(ViewOf(*mirrored), v.filtered, Everywhere) /
                   DisplayError(v.filtered, v.truth, Everywhere)};
  });
}

}  // namespace

std::vector<Case> InvarianceCases() {
  return {
      {25,
       "tiles",
       "a room with a mirror rendered in tiles of 32, 64, 7x3 and 1x1: pixels that differ after the filter",
       "67x45, 8 spp",
       "",
       {{"different", 0}},
       Tiles},
      {47,
       "seams",
       "a room in tiles of 32 px with seeds of their own, every other one with a quarter of the samples: "
       "pixels that differ if its rows are filtered as they come; seam index of the tiles, of the error over "
       "that of the noisy picture; of blocks of 64 px, against the whole; error of the blocks over that of "
       "the whole",
       "192x128, 8 and 32 spp",
       "",
       {{"different", 0}, {"tile seam", 1.05}, {"block seam", 1.05}, {"over whole", 1.05}},
       Seams},
      {26,
       "threads",
       "one film on 1, 2, 3 and 16 threads, in shuffled order, and without a pool: pixels that differ",
       "131x97, 16 spp",
       "",
       {{"different", 0}},
       Threads},
      {30,
       "dark room",
       "a film 2^20 times darker, its result scaled back: largest relative difference; the largest of those "
       "for factors of 1e-6, 0.3, 7 and 1000",
       "128x96, 16 spp",
       "",
       {{"2^20", 1e-4}, {"any factor", 1e-4}},
       DarkRoom},
      {31,
       "mirrored film",
       "a film mirrored horizontally: mean square difference over the error",
       "128x128, 16 spp",
       "was 1e-4: the order of axes and directions is fixed so that all machines agree, and the mirrored "
       "film is clustered differently: 0.1 of the error",
       {{"difference", 0.1}},
       Mirrored},
  };
}

}  // namespace lumifold::stability
