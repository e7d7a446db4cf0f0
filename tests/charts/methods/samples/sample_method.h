#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/baseline.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "tests/charts/film_source.h"
#include "worker/render/renderer.h"

namespace lumifold::charts {

/// What the methods here read of one camera sample. All finite: of a bad sample, light and features are 0.
struct ChartSample {
  scene::Vec2 point;     // in the picture, in pixels
  scene::Vec2 lens;      // where its ray passes the lens; 0 for a pinhole
  scene::Vec3 radiance;  // C
  scene::Vec3 direct;    // D
  scene::Vec3 indirect;  // I
  scene::Vec3 albedo;    // T
  scene::Vec3 emitted;   // E
  scene::Vec3 position;  // of the first surface, in the world; 0 where nothing is hit
  scene::Vec3 normal;    // its shading normal; 0 where nothing is hit
  float distance = 0;    // along the ray; 0 where nothing is hit
  std::array<scene::Vec2, render::kFirstSurfacePairs> random;  // what the first surface drew from
};

/// The samples of a frame, one by one, and what else the methods read. 31 numbers a sample: 98 MB at 256x192
/// and 16 samples a pixel.
struct SampleSet {
  int width = 0;
  int height = 0;
  uint32_t samples_per_pixel = 0;
  std::vector<ChartSample> samples;    // pixel by pixel in row-major order, then by index
  const LayeredImage* film = nullptr;  // of the same scene, size, samples and seed
  LayeredImage guide;                  // see Renderer::TraceGuide
  double guide_seconds = 0;            // what tracing it took on the clock

  const ChartSample& At(int x, int y, uint32_t index) const {
    return samples[(static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) *
                       samples_per_pixel +
                   index];
  }
};

/// More samples than this are refused: they would not fit a small machine's memory, nor the methods end.
inline constexpr int64_t kMostChartSamples = int64_t{256} * 192 * 16;

/// Traces the samples that `film` was made of (settings.samples may be 0: none), and the guide; `renderer` is
/// of the film's settings and scene. `film` must outlive the result. Errors: kInvalidArgument where the film
/// has another size; kResourceExhausted for more samples than kMostChartSamples.
absl::StatusOr<SampleSet> TraceSampleSet(const render::Renderer& renderer, const FilmSettings& settings,
                                         const LayeredImage& film, TaskPool* pool);

/// A method that takes what a film does not hold: samples one by one, or rays of its own. Its function takes
/// one value for each parameter, in their order and within their limits, and gives R G B, finite, with the
/// same bits for any pool.
struct SampleMethod {
  std::string name;
  std::string summary;  // one line
  std::string source;   // whose method it is; says so where ours is a reconstruction
  std::vector<filter::BaselineParameter> parameters;
  bool uses_samples = true;  // where not, a set of 0 samples a pixel will do, whatever the film has
  bool uses_guide = false;   // whether SampleSet::guide_seconds are part of its cost
  absl::StatusOr<std::array<Plane, 3>> (*filter)(const SampleSet& set, absl::Span<const float> values,
                                                 TaskPool* pool) = nullptr;
};

/// All of them, in the order tables list them.
const std::vector<SampleMethod>& SampleMethods();

}  // namespace lumifold::charts
