#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "worker/render/geometry_sample.h"
#include "worker/render/layer_sample.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// The pairs of random numbers that light the first surface: the choices of light and lobe, the point on the
/// light, the direction that goes on.
inline constexpr size_t kFirstSurfacePairs = 3;

/// One camera sample with all that went into it: (seed, frame, pixel, index) is the key of its random
/// numbers, see Sampler.
struct SampleRecord {
  int64_t pixel = 0;  // row-major number in the frame
  uint32_t index = 0;
  scene::Vec2 point;  // in the picture, in pixels
  scene::Vec2 lens;   // where its ray passes the lens, in [0, 1)^2; 0 for a pinhole
  std::array<scene::Vec2, kFirstSurfacePairs> random;
  LayerSample layers;
  GeometrySample geometry;  // of its own ray
};

/// Takes the samples Renderer::TraceSamples traces, one by one. For tests and charts: no unit goes this way.
class SampleSink {
 public:
  virtual ~SampleSink() = default;
  virtual void OnSample(const SampleRecord& record) = 0;
};

}  // namespace lumifold::render
