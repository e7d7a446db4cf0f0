#pragma once

#include "filter/denoise/settings.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// Filters a layer of which most pixels have one half alone: its noise is a rough guess, so that geometry
/// decides.
/// Shapes:  mean: the layer, 3 planes; geometry: its features; points: null, or fragments with their light.
///          Result: 3 planes, and 3 values for each point.
/// Threads: identical for any pool.
ManifoldResult FilterSingle(const Halves& halves, const Planes& mean, const Planes& geometry,
                            const LayerSettings& settings, const SlicePoints* points, TaskPool* pool);

}  // namespace lumifold::filter
