#include "tests/charts/films/adaptive_film.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "filter/denoise/denoise.h"
#include "filter/image/rect.h"
#include "server/film/film_builder.h"
#include "server/job/tile_grid.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

constexpr int kTileSize = 32;

using job::FrameSampling;

/// The samples of a frame so far, in tiles as a farm has them.
class Tiles {
 public:
  Tiles(const render::Renderer& renderer, const job::SamplingSettings& settings, TaskPool* pool)
      : renderer_(renderer), width_(settings.width), height_(settings.height), pool_(pool) {
    const job::TileGrid grid(width_, height_, kTileSize);
    for (int i = 0; i < grid.count(); ++i) tiles_.push_back({grid.RectOf(i)});
    ParallelFor(pool_, static_cast<int64_t>(tiles_.size()), [&](int64_t i) {
      Tile& tile = tiles_[static_cast<size_t>(i)];
      tile.geometry = renderer_.RenderGeometry(tile.rect, 0);
    });
  }

  void Render(const FrameSampling& sampling, size_t round) {
    ParallelFor(pool_, static_cast<int64_t>(tiles_.size()), [&](int64_t i) {
      Tile& tile = tiles_[static_cast<size_t>(i)];
      const TileSamples samples = sampling.SamplesOf(tile.rect, round);
      if (samples.CountIn(tile.rect.width(), tile.rect.height()) == 0) return;
      render::RenderCounts counts;
      tile.sums.Add(renderer_.RenderPass(tile.rect, 0, samples, &counts));
      tile.rays += static_cast<double>(counts.rays);
      tile.samples += static_cast<double>(counts.samples);
    });
  }

  /// Rays of a sample, by block of the frame; the same in all blocks of a tile, as a unit reports them.
  std::vector<double> Costs() const {
    const auto columns = static_cast<size_t>(BlocksIn(width_));
    std::vector<double> costs(columns * static_cast<size_t>(BlocksIn(height_)));
    for (const Tile& tile : tiles_) {
      for (int y = tile.rect.y0; y < tile.rect.y1; y += kSampleBlock) {
        for (int x = tile.rect.x0; x < tile.rect.x1; x += kSampleBlock)
          costs[static_cast<size_t>(y / kSampleBlock) * columns + static_cast<size_t>(x / kSampleBlock)] =
              std::max(1.0, tile.rays / tile.samples);
      }
    }
    return costs;
  }

  EdgedImage Film() const {
    film::FilmBuilder film(width_, height_);
    for (const Tile& tile : tiles_) {
      film.SetMeans(tile.rect, tile.sums);
      film.SetGeometry(tile.rect, tile.geometry.pixels);
      film.AddEdges(tile.geometry.edges);
    }
    return film.Take();
  }

 private:
  struct Tile {
    Rect rect;
    film::TileSums sums = {};
    EdgedImage geometry = {};
    double rays = 0;
    double samples = 0;
  };

  const render::Renderer& renderer_;
  const int width_;
  const int height_;
  TaskPool* const pool_;
  std::vector<Tile> tiles_;
};

double MeanOf(const job::Allocation& samples) {
  double sum = 0;
  for (const uint32_t count : samples) sum += count;
  return sum / static_cast<double>(samples.size());
}

}  // namespace

AdaptiveFilm RenderAdaptively(const render::Renderer& renderer, const job::SamplingSettings& settings,
                              metrics::ErrorMetric metric, TaskPool* pool) {
  AdaptiveFilm result;
  double last = CpuSeconds();
  const auto charge = [&last](double* seconds) {
    const double now = CpuSeconds();
    *seconds += now - last;
    last = now;
  };
  FrameSampling sampling(settings);
  Tiles tiles(renderer, settings, pool);
  const auto errors_of = [&](bool is_result) {
    result.film = tiles.Film();
    const filter::Frame frame(result.film);
    FilteredPicture filtered = is_result || settings.target_error > 0
                                   ? filter::DenoiseWithDeviation(frame, pool)
                                   : filter::DenoiseToEstimate(frame, pool);
    const metrics::FilteredFilm view = {result.film.pixels, filtered, &result.film.edges};
    std::vector<double> errors = metrics::EstimateError(view, kSampleBlock, metric, pool).blocks;
    result.picture = std::move(filtered.picture);
    ++result.filterings;
    return errors;
  };
  for (size_t round = 0; round < sampling.rounds().size(); ++round) {
    tiles.Render(sampling, round);
    charge(&result.render_seconds);
    if (round > 0 && !sampling.is_final()) {
      const std::vector<double> costs = tiles.Costs();
      const std::vector<double> errors =
          sampling.NeedsPicture(costs) ? errors_of(false) : std::vector<double>(costs.size(), -1);
      sampling.AddEstimate(static_cast<int>(round), errors, costs);
    }
    charge(&result.filter_seconds);
  }
  result.estimated_error = sampling.MeasuredError(errors_of(true));
  charge(&result.filter_seconds);
  result.mean_samples = MeanOf(sampling.rounds().back());
  return result;
}

}  // namespace lumifold::charts
