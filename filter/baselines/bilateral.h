#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// out_i = sum_j w_ij f_j / sum_j w_ij, w_ij = m_j exp(-|i - j|^2 / 2 sigma_s^2 - |u_i - u_j|^2 / 2) over the
/// square of radius ceil(2.5 sigma_s), cut at the picture's edge.
/// Shapes:  signals: C planes, features: d planes divided by their ranges, mask >= 0: W x H, finite. Where
///          nothing weighs, out is the signal.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Tomasi & Manduchi 1998, Petschnigg et al. 2004 (features of another picture).
Planes BilateralFilter(const Planes& signals, const Planes& features, ConstFloatView mask, float sigma_s,
                       TaskPool* pool);

/// "bilateral": on the picture as displayed, whose colours are the range.
Baseline BilateralBaseline();

/// "cross-bilateral": on each layer of light, put together as the film's model has it; the range is the
/// geometry and, where sigma_q is over 0, the layer's patches.
Baseline CrossBilateralBaseline();

}  // namespace lumifold::filter
