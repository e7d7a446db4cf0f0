#pragma once

#include "filter/denoise/settings.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// Filters a layer of which most pixels have one half alone: its noise is a rough guess, so that geometry decides.
/// Shapes:  mean: the layer, 3 planes; geometry: its features. Result: 3 planes.
/// Threads: identical for any pool.
Planes FilterSingle(const Halves& halves, const Planes& mean, const Planes& geometry,
                    const LayerSettings& settings, TaskPool* pool);

}  // namespace lumifold::filter
