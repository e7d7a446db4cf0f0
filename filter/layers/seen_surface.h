#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/features.h"

namespace lumifold::filter {

/// What each pixel of a film shows: the surface seen first or, where less than half of the pixel shows a
/// diffuse lobe there, the nearest one seen in the mirror or through the glass, if that fills more of it.
/// W x H planes.
struct SeenSurface {
  Planes albedo;   // 3: T of the surface seen first and of all levels, their throughput in it
  Planes normal;   // 3: turned back by the mirrors, as a level's
  Plane distance;  // along all of the way
  Plane mask;      // the part of the pixel that the surface covers

  GeometryViews geometry() const { return {ViewOf(normal), distance.view()}; }
};

/// Levels that the film has not count as black. Threads: identical for any pool.
SeenSurface SeenSurfaceOf(const LayeredImage& film, TaskPool* pool);

}  // namespace lumifold::filter
