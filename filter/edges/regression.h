#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// Corrects the filtered picture F where several surfaces meet in a pixel: at edge pixels and next to them,
/// at metals and where a mirror or glass is seen. There C and F are fitted by linear functions of T, the
/// normal, the covered part, S, the distance and the roughness over a 13x13 window, weighted by the
/// similarity of F; a ridge draws slopes towards 0 as C's noise asks. Functions are fitted at a quarter of
/// the pixels, and each pixel takes the mean of those around it.
///
/// Each pixel becomes a mixture, by inverse error, of F unchanged, F corrected by the fit of C - F, and F
/// replaced by the fit of C ("refit"), which has none of F's noise. Half A of C judges the fit of half B and
/// the reverse; errors are averaged over such pixels nearby. The fits weigh more as samples grow. In mirrors
/// off the edge set, noisy pixels weigh less. Does nothing where one half alone is known.
///
/// Shapes:  coverage_change: what F has of the truth that C has not (CoverageChange), W x H, 3 planes.
/// Threads: identical for any pool.
/// Source:  the regression and the collaborative mean over fits of Bitterli et al. 2016.
void RegressEdges(const Frame& frame, const Planes& coverage_change, TaskPool* pool, Picture* picture);

/// Radius in pixels of what a pixel of the result depends on.
int RegressionWindow();

}  // namespace lumifold::filter
