#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/features.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

struct RegressionParams {
  float sigma_px = 4;        // of a pixel's weight by its distance in the picture; windows reach 1.5 sigma
  float sigma_light = 0.3f;  // of its weight by F, stabilised
  float slope = 4;           // deviation of a slope's prior: over a term's unit, C changes by so many times F
};

/// Candidates for pixels where several surfaces meet, from linear functions of T, the normal, the covered part, S, the
/// distance and the roughness. C and C - F of each half are fitted over a window, weighted by the similarity of
/// F; a ridge draws slopes towards 0 as C's noise asks. Functions are fitted at a quarter of the pixels, and each pixel
/// takes the mean of those around it.
/// Shapes:  mixed: 1 where a pixel is fitted, else 0 (MixedPixelsOf). `change`: of F. `knee`: of the stabilised F, over the picture's mean. Result: first F + the fit of
///          C - F, which has less bias than F, then the fit of C, which has none of F's noise; both equal F elsewhere.
/// Threads: identical for any pool.
/// Source:  the regression and the collaborative mean over fits of Bitterli et al. 2016.
std::vector<FrameChange> FitMixedPixels(const Frame& frame, const Plane& mixed, const FrameChange& change,
                                        const RegressionParams& params, float knee,
                                        const GeometryRanges& ranges, TaskPool* pool);

/// Radius in pixels of what a pixel of the result depends on.
int RegressionWindow(const RegressionParams& params);

}  // namespace lumifold::filter
