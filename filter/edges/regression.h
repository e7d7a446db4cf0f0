#pragma once

#include <array>

#include "filter/image/layered_image.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// Takes out what the filter F gets wrong where surfaces meet within a pixel: at the pixels of the edge set
/// and next to them, at metals and where a mirror or glass is seen. There C and F are fitted by a linear
/// function of T, the normal, the covered part, S, the distance and the roughness over the 13x13 pixels about
/// it, the more the more alike their F is; slopes are drawn to 0 as C's noise asks. F is mixed with what the
/// mean of the functions fitted about a pixel says of C - F there, added to F, and with what it says of C
/// itself, which has nothing of F's noise. Functions are fitted at a fourth of the pixels. Each half of C is
/// fitted by itself: how far the fits are followed is told by the errors of each against the other, averaged
/// over such pixels near by, and by the number of samples; in mirrors off the edge set noisy pixels count
/// less for it, and F is believed where they do not tell. Does nothing where one half alone is known.
/// `change`: what F has of the truth that C has not (EdgeMeansChange), W x H, 3 planes. `edges` may be null.
/// Source: the regression of Bitterli et al. 2016 and their mean over fits, here beside another filter, too.
/// Threads: identical for any pool.
void RegressEdges(const LayeredImage& film, const LayeredImage* edges, const Planes& change, TaskPool* pool,
                  std::array<Plane, 3>* picture);

}  // namespace lumifold::filter
