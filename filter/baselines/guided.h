#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The guided filter: in every window of radius r, p = a . g + b by least squares with ridge epsilon; out is
/// mean(a) . g + mean(b), means over the windows a pixel lies in.
/// Shapes:  signals: C planes, guide: M planes of variance about 1, mask >= 0: W x H, finite. Windows are cut
///          at the picture's edge.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  He, Sun & Tang 2010.
Planes GuidedFilter(const Planes& signals, const Planes& guide, ConstFloatView mask, int radius,
                    double epsilon, TaskPool* pool);

/// "guided": on each layer of light; the guide is normals and depth, each brought to variance 1 over the
/// frame. Without guide rays, which a film does not hold.
/// Source:  Bauszat, Eisemann & Magnor 2011.
Baseline GuidedBaseline();

}  // namespace lumifold::filter
