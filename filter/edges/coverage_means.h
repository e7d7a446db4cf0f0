#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// What the sub-samples of edge pixels know of T and E better than the pixel's own samples: the change of
/// (D + I) T + E when T and E are taken as means of both, each trusted by the square of its count, for both
/// are spread evenly over the pixel. It takes out the noise of where few samples fell, and vanishes as
/// samples grow. What is thinner than the sub-samples' grid they all miss or all hit; beside what radiates,
/// where that is seen, the own samples of all pixels whose surroundings look alike to the sub-samples say
/// together what is beyond these. T is left where a mirror or glass takes part of the pixel: what samples of
/// the surface are too many are too few of what is seen there. `light`: D + I as filtered, W x H, 3 planes.
/// `edges`: as FilterFilm() has them; may be null. Result: W x H, 3 planes; 0 off the edges and where it is
/// not finite. Threads: identical for any pool. Source: our own; the likeness of non-local means (Buades et
/// al. 2005).
Planes EdgeMeansChange(const LayeredImage& film, const LayeredImage* edges, const Planes& light,
                       TaskPool* pool);

}  // namespace lumifold::filter
