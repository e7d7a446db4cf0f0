#pragma once

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"

namespace lumifold::filter {

/// Adds halves to a film that has none: A = X + e and B = X - e for each layer of light and
/// the remainder, with e a fixed pseudo-random number of the variance that the noise of X is estimated to
/// have there. Where that noise is normal and the estimate right, A and B are independent and each has twice
/// X's variance, as real halves have; X stays their mean. The estimate takes what second differences show
/// within a window, so detail of one pixel's size counts as noise.
/// (x0, y0) is where the film's first pixel lies in the picture it is a part of: e belongs to the picture's
/// pixel, and parts that overlap agree but for 8 pixels along an edge that is none of the picture's.
/// Shapes:  film: W x H with noisy, direct, indirect, albedo, emission, N.*, distance.Z; the channels *_a,
///          *_b, samples_a.Y and samples_b.Y are added, and must not be there.
/// Edges:   the estimate looks at 3x3 pixels of one surface only; a pixel without any near takes 0.
/// Threads: identical result for any pool, null included.
/// Source:  Immerkaer 1996 (noise from second differences); Tian, Fithian et al. 2018 and later (splitting a
///          normal variable in two by adding noise).
void SplitIntoHalves(LayeredImage* film, TaskPool* pool, int x0 = 0, int y0 = 0);

}  // namespace lumifold::filter
