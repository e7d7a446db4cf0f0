#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/fit_call.h"
#include "filter/manifold/layer_call.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

PlaneViews ViewsOf(absl::Span<const Plane> planes);

/// Coordinates of patches that are still to be projected, as ProjectPatches (filter/manifold/nlm_space.h)
/// does.
struct PatchProjection {
  PlaneViews color;
  int radius = 0;
  int dimensions = 0;  // 0: there are none
  absl::Span<const float> taps;
  float scale = 1;  // that the coordinates are multiplied by
};

/// What ManifoldFilterAtPoints takes. The picture has pixels, and the rest is as it asks for.
struct ManifoldCall {
  PlaneViews signals;
  PatchProjection patches;  // the first features
  PlaneViews features;      // the others
  ConstFloatView mask;
  const ManifoldParams& params;
  float reach;
  const SlicePoints* points;  // may be null

  size_t FeatureCount() const { return static_cast<size_t>(patches.dimensions) + features.size(); }
};

/// A processor beside this machine's own. ManifoldFilterAtPoints, FilterGuided (filter/layers/guide.h),
/// ModelGrid and the stages of layers use the one that their pool has. nullopt: the device cannot, and the
/// processor does it.
/// Threads: safe concurrently.
class FilterDevice {
 public:
  virtual ~FilterDevice() = default;

  /// A name for its bits where they are not the processor's; empty: they are.
  virtual std::string OtherBits() const = 0;

  virtual std::optional<ManifoldResult> Filter(const ManifoldCall& call) = 0;
  virtual std::optional<FitResult> Fit(const FitCall& call) = 0;
  virtual std::optional<LayerResult> FilterLayer(const LayerCall& call) = 0;
};

/// `pool` with a device; `device` may be null.
std::unique_ptr<TaskPool> WithDevice(std::unique_ptr<TaskPool> pool, std::shared_ptr<FilterDevice> device);

/// The device of a pool that WithDevice() has made; null for another, and for null.
FilterDevice* DeviceOf(TaskPool* pool);

}  // namespace lumifold::filter
