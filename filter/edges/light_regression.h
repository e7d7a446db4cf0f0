#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/choice.h"
#include "filter/layers/halves.h"
#include "filter/layers/layer_fragments.h"
#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

/// A candidate for the light of a layer where several surfaces meet: linear functions of the position, the
/// normal, the distance and the roughness, fitted to the halves' light around each mixed pixel and each
/// fragment. A fragment is a sample of its own, with the features of its surface alone; samples are weighted
/// by their distance in the picture, by their features, by the similarity of F, and by their part of a
/// pixel's samples.
/// Shapes:  halves: as UseFragments() leaves them. geometry: of the layer, the fragments' own features last.
///          `filtered`: F. `knee`: of the stabilised F, over the layer's mean. Result: F off mixed pixels
///          (Halves::is_mixed).
/// Threads: identical for any pool.
/// Source:  the regression of Bitterli et al. 2016, on fragments instead of pixels.
Candidate FitLight(const Halves& halves, const LayerFragments& fragments, const Planes& geometry,
                   const Candidate& filtered, const RegressionParams& params, float knee, TaskPool* pool);

}  // namespace lumifold::filter
