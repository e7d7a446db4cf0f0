#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "tests/charts/access/charts_access.h"
#include "tests/charts/films/film_source.h"
#include "worker/render/renderer.h"

namespace lumifold::charts {

/// The part of one camera sample that the methods read. All values are finite: a sample that is NaN or
/// infinite has light and features of 0.
struct ChartSample {
  scene::Vec2 point;     // in the picture, in pixels
  scene::Vec2 lens;      // where its ray passes the lens; 0 for a pinhole
  scene::Vec3 radiance;  // C
  scene::Vec3 direct;    // D
  scene::Vec3 indirect;  // I
  scene::Vec3 albedo;    // T
  scene::Vec3 emitted;   // E
  scene::Vec3 position;  // of the first surface, in world space; 0 if nothing is hit
  scene::Vec3 normal;    // its shading normal; 0 if nothing is hit
  float distance = 0;    // along the ray, in metres; 0 if nothing is hit
  std::array<scene::Vec2, render::kFirstSurfacePairs> random;  // the random numbers of the first surface
};

/// The single samples of a frame, and the other inputs of the methods. A sample is 31 numbers: 98 MB at
/// 256x192 and 16 samples per pixel.
struct SampleSet {
  int width = 0;
  int height = 0;
  uint32_t samples_per_pixel = 0;
  std::vector<ChartSample> samples;    // pixel by pixel in row-major order, then by index
  const LayeredImage* film = nullptr;  // of the same scene, size, samples and seed
  LayeredImage guide;                  // see ChartsAccess::RenderGuide
  double guide_seconds = 0;            // wall-clock seconds that tracing it took

  const ChartSample& At(int x, int y, uint32_t index) const {
    return samples[(static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) *
                       samples_per_pixel +
                   index];
  }
};

/// The most samples a set may have: more would exceed a small machine's memory, and the methods' time.
inline constexpr int64_t kMostChartSamples = int64_t{256} * 192 * 16;

/// Traces the samples that `film` was made of (settings.samples may be 0: none), and the guide; `renderer` is
/// of the film's settings and scene. `film` must outlive the result. Errors: kInvalidArgument if the film has
/// another size; kResourceExhausted for more samples than kMostChartSamples.
absl::StatusOr<SampleSet> TraceSampleSet(const render::Renderer& renderer, const FilmSettings& settings,
                                         const LayeredImage& film, TaskPool* pool);

}  // namespace lumifold::charts
