#pragma once

#include <memory>
#include <optional>

#include "filter/image/parallel.h"
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

/// A processor beside this machine's own that filters on manifolds. ManifoldFilterAtPoints uses the one that
/// its pool has.
/// Threads: safe concurrently.
class ManifoldDevice {
 public:
  virtual ~ManifoldDevice() = default;

  /// The bits of ManifoldFilterAtPoints; nullopt: the device cannot, and the processor does it.
  virtual std::optional<ManifoldResult> Filter(const ManifoldCall& call) = 0;
};

/// `pool` with a device; `device` may be null.
std::unique_ptr<TaskPool> WithDevice(std::unique_ptr<TaskPool> pool, std::shared_ptr<ManifoldDevice> device);
/// The device of a pool that WithDevice() has made; null for another, and for null.
ManifoldDevice* DeviceOf(TaskPool* pool);

}  // namespace lumifold::filter
