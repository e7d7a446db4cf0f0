#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/features.h"
#include "filter/layers/frame.h"
#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

/// Candidates for pixels where several surfaces meet, from linear functions of T, the normal, the covered
/// part, S, the distance and the roughness. C and C - F of each half are fitted over a window, weighted by
/// the similarity of F; a ridge draws slopes towards 0 as C's noise asks. Functions are fitted at a quarter
/// of the pixels, and each pixel takes the mean of those around it.
/// Shapes:  mixed: 1 where a pixel is fitted, else 0 (MixedPixelsOf). `change`: of F. `knee`: of the
///          stabilised F, over the picture's mean. Result: first F + the fit of C - F, which has less bias
///          than F, then the fit of C, which has none of F's noise; both equal F elsewhere.
/// Threads: identical for any pool.
/// Source:  the regression of Bitterli et al. 2016.
std::vector<FrameChange> FitMixedPixels(const Frame& frame, const Plane& mixed, const FrameChange& change,
                                        const RegressionParams& params, float knee,
                                        const GeometryRanges& ranges, TaskPool* pool);

}  // namespace lumifold::filter
