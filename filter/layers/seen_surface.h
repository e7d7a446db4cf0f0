#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/features.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// The surface that dominates each pixel: the first hit, or, where less than half of the pixel shows a
/// diffuse lobe there, the nearest surface seen in the mirror or through the glass, if it covers more of the
/// pixel. W x H planes.
struct SeenSurface {
  Planes albedo;   // 3: sum of T over the first hit and all levels, with the throughput of their chains
  Planes normal;   // 3: turned back by mirrors, as a level's
  Plane distance;  // along the whole way
  Plane mask;      // part of the pixel that the surface covers

  GeometryViews geometry() const { return {ViewOf(normal), distance.view()}; }
};

/// Levels that the film lacks count as black.
/// Threads: identical for any pool.
SeenSurface SeenSurfaceOf(const Frame& frame, TaskPool* pool);

}  // namespace lumifold::filter
