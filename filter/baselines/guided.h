#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The guided filter: in every window of radius r, p = a . g + b by least squares with ridge epsilon. The
/// result is mean(a) . g + mean(b), with means over the windows that contain the pixel.
/// Shapes:  signals: C planes, guide: M planes of variance about 1, mask >= 0: W x H, finite.
/// Edges:   windows are cropped at the picture's edge.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  He, Sun & Tang 2010.
Planes GuidedFilter(const Planes& signals, const Planes& guide, ConstFloatView mask, int radius,
                    double epsilon, TaskPool* pool);

/// "guided": on each layer of light. The guide is normals and depth, each normalised to variance 1 over the
/// frame. Guide rays are left out, since a film does not hold them.
/// Source:  Bauszat, Eisemann & Magnor 2011.
Baseline GuidedBaseline();

}  // namespace lumifold::filter
