#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// Change of (D + I) T + E at edge pixels when T and E are estimated from the pixel's own samples and its
/// sub-samples together, each weighted by the square of its count, since both are stratified over the pixel.
/// It removes the noise of the coverage and vanishes as samples grow.
///
/// A detail thinner than the sub-samples' grid is missed or hit by all of them. Next to emitters, the own
/// samples of all pixels with similar sub-samples nearby estimate together what the sub-samples miss. T stays
/// where the pixel shows a level: the samples that hit its surface and those of the level depend on each
/// other.
///
/// Shapes:  light: D + I as filtered, W x H, 3 planes. Result: W x H, 3 planes; 0 off the edge set and where
///          the change is not finite.
/// Threads: identical for any pool.
/// Source:  our own; the patch distance is that of non-local means (Buades et al. 2005).
Planes CoverageChange(const Frame& frame, const Planes& light, TaskPool* pool);

/// Radius in pixels of what a pixel of the result depends on.
int CoverageWindow();

}  // namespace lumifold::filter
