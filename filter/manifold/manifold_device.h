#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// What ManifoldFilterAtPoints takes. The picture has pixels, and the rest is as it asks for.
struct ManifoldCall {
  const Planes& signals;
  const Planes& features;
  ConstFloatView mask;
  const ManifoldParams& params;
  float reach;
  const SlicePoints* points;  // may be null
};

/// What ProjectPatches takes (filter/layers/nlm_space.h): a picture that has pixels, and a basis.
struct ProjectionCall {
  const Planes& color;
  int radius;
  int dimensions;
  const std::vector<float>& taps;
};

/// A processor beside this machine's own. ManifoldFilterAtPoints and ProjectPatches use the one that their
/// pool has.
/// Threads: safe concurrently.
class ManifoldDevice {
 public:
  virtual ~ManifoldDevice() = default;

  /// A name for its bits where they are not the processor's; empty: they are.
  virtual std::string OtherBits() const = 0;

  /// The result of ManifoldFilterAtPoints; nullopt: the device cannot, and the processor does it.
  virtual std::optional<ManifoldResult> Filter(const ManifoldCall& call) = 0;
  /// The same of ProjectPatches.
  virtual std::optional<Planes> Project(const ProjectionCall& call) = 0;
};

/// `pool` with a device; `device` may be null.
std::unique_ptr<TaskPool> WithDevice(std::unique_ptr<TaskPool> pool, std::shared_ptr<ManifoldDevice> device);
/// The device of a pool that WithDevice() has made; null for another, and for null.
ManifoldDevice* DeviceOf(TaskPool* pool);

}  // namespace lumifold::filter
