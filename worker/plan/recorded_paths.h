#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/render/geometry/camera.h"
#include "worker/render/renderer.h"
#include "worker/render/sampling/roulette.h"
#include "worker/render/tracing/path_tracer.h"

namespace lumifold::plan {

inline constexpr uint32_t kProbeSamples = 8;  // per pixel

/// What a pixel's squared error is divided by. Dark pixels count by their share of the frame's light, as in
/// relMSE.
inline double SquaredLight(double of_pixel, double of_frame) {
  constexpr double kFloor = 0.01;
  return of_pixel * of_pixel + kFloor * of_frame * of_frame;
}

/// What noise in a pixel counts.
struct PixelLight {
  /// What squared radiance is divided by: the curve of displays is about a square root.
  double light = 1;
  /// Radiance beyond this counts as outliers do, not by its square: the display's curve bends.
  double outlier = 1;
};

/// What paths cost: sums, so that only ratios of two rules on the same paths mean anything.
struct PathCosts {
  double noise = 0;  // of the indirect radiance that they bring, whose mean is the same with any rule
  double rays = 0;
};

/// Paths traced without Russian roulette, from which follows what any rule would cost.
class RecordedPaths {
 public:
  /// Adds the path of `vertices`, as PathTracer::RecordIndirect gives them. Nothing for a path without
  /// vertices or with bad radiance.
  void Add(std::span<const render::PathVertex> vertices, const PixelLight& pixel);

  /// The expectation over the rule's decisions.
  PathCosts CostsWith(const render::Roulette& rule) const;

 private:
  std::vector<render::PathVertex> vertices_;  // of all paths, one after another
  std::vector<PixelLight> pixels_;            // of each path
  std::vector<size_t> ends_;                  // one past each path's last vertex
};

/// Traces kProbeSamples paths of each pixel of `picture`. An outlier is a path that brings more than all
/// samples of its pixel together. Adds the number of camera samples that this took to *samples.
RecordedPaths RecordPaths(const render::PathTracer& tracer, const render::PictureCamera& camera,
                          const render::RenderSettings& picture, int64_t* samples);

}  // namespace lumifold::plan
