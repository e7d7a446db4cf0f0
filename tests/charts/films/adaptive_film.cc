#include "tests/charts/films/adaptive_film.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "filter/denoise/denoise.h"
#include "filter/image/rect.h"
#include "server/film/film_builder.h"
#include "tests/support/cpu_seconds.h"

namespace lumifold::charts {
namespace {

using sampling::Allocation;
using sampling::FrameSampling;

/// The samples of a frame so far, block by block.
class Blocks {
 public:
  Blocks(const render::Renderer& renderer, const sampling::SamplingSettings& settings, TaskPool* pool)
      : renderer_(renderer), width_(settings.width), height_(settings.height), pool_(pool) {
    for (int y = 0; y < height_; y += kSampleBlock) {
      for (int x = 0; x < width_; x += kSampleBlock)
        blocks_.push_back(
            {{x, y, std::min(x + kSampleBlock, width_), std::min(y + kSampleBlock, height_)}, {}, {}});
    }
    ParallelFor(pool_, static_cast<int64_t>(blocks_.size()), [&](int64_t i) {
      Block& block = blocks_[static_cast<size_t>(i)];
      block.geometry = renderer_.RenderGeometry(block.rect, 0);
    });
  }

  /// Renders what `to` has over `from`.
  void Render(const Allocation& from, const Allocation& to) {
    ParallelFor(pool_, static_cast<int64_t>(blocks_.size()), [&](int64_t number) {
      const auto i = static_cast<size_t>(number);
      if (to[i] == from[i]) return;
      render::RenderCounts counts;
      blocks_[i].sums.Add(renderer_.RenderPass(blocks_[i].rect, 0, {from[i], to[i]}, &counts));
    });
  }

  EdgedImage Film() const {
    film::FilmBuilder film(width_, height_);
    for (const Block& block : blocks_) {
      film.SetMeans(block.rect, block.sums);
      film.SetGeometry(block.rect, block.geometry.pixels);
      film.AddEdges(block.geometry.edges);
    }
    return film.Take();
  }

 private:
  struct Block {
    Rect rect;
    film::TileSums sums;
    EdgedImage geometry;
  };

  const render::Renderer& renderer_;
  const int width_;
  const int height_;
  TaskPool* const pool_;
  std::vector<Block> blocks_;
};

struct Filtered {
  EdgedImage film;
  Picture picture;

  metrics::FilteredFilm View() const { return {film.pixels, ViewOf(picture)}; }
};

double MeanOf(const Allocation& samples) {
  double sum = 0;
  for (const uint32_t count : samples) sum += count;
  return sum / static_cast<double>(samples.size());
}

}  // namespace

AdaptiveFilm RenderAdaptively(const render::Renderer& renderer, const sampling::SamplingSettings& settings,
                              metrics::ErrorMetric metric, TaskPool* pool) {
  AdaptiveFilm result;
  double last = CpuSeconds();
  const auto charge = [&last](double* seconds) {
    const double now = CpuSeconds();
    *seconds += now - last;
    last = now;
  };
  FrameSampling sampling(settings);
  Blocks blocks(renderer, settings, pool);
  Allocation done(sampling.rounds().front().size());
  std::optional<Filtered> earlier;
  for (size_t round = 0; round < sampling.rounds().size(); ++round) {
    const Allocation& next = sampling.rounds()[round];
    blocks.Render(done, next);
    done = next;
    charge(&result.render_seconds);
    const bool is_last = sampling.is_final() && round + 1 == sampling.rounds().size();
    if (sampling.is_final() && !is_last) continue;
    Filtered filtered = {blocks.Film(), {}};
    filtered.picture = filter::Denoise(filtered.film.pixels, &filtered.film.edges, pool);
    if (earlier.has_value()) {
      const metrics::ErrorEstimate estimate =
          metrics::EstimateError(earlier->View(), filtered.View(), kSampleBlock, metric, pool);
      if (!is_last) {
        sampling.AddEstimate(static_cast<int>(round), estimate.blocks, std::vector<double>(done.size(), 1.0));
        ++result.estimates;
      }
      if (sampling.is_final() && round + 1 == sampling.rounds().size())
        result.estimated_error = sampling.MeasuredError(estimate.blocks);
    }
    earlier = std::move(filtered);
    charge(&result.filter_seconds);
  }
  result.film = std::move(earlier->film);
  result.picture = std::move(earlier->picture);
  result.mean_samples = MeanOf(done);
  return result;
}

}  // namespace lumifold::charts
