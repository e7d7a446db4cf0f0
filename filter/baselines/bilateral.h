#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// out_i = sum_j w_ij f_j / sum_j w_ij with w_ij = m_j exp(-|i - j|^2 / 2 sigma_s^2 - |u_i - u_j|^2 / 2),
/// over the square of radius ceil(2.5 sigma_s), cropped at the picture's edge. If all weights are 0, out is
/// the signal.
/// Shapes:  signals: C planes, features: d planes divided by their ranges, mask >= 0: W x H, finite.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Tomasi & Manduchi 1998, Petschnigg et al. 2004 (features of another picture).
Planes BilateralFilter(const Planes& signals, const Planes& features, ConstFloatView mask, float sigma_s,
                       TaskPool* pool);

/// "bilateral": on the displayed picture, with its own colours as range.
Baseline BilateralBaseline();

/// "cross-bilateral": on each layer of light, recombined as by the default method. The range is the geometry
/// and, if sigma_q > 0, the layer's patches.
Baseline CrossBilateralBaseline();

}  // namespace lumifold::filter
