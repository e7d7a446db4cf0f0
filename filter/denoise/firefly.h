#pragma once

#include "filter/layers/halves.h"

namespace lumifold::filter {

/// Takes single bright pixels out of both halves: where a half's luminance is over twice the 75th percentile
/// of its 5x5 neighbourhood in X, and noise explains it (three sigma reach back down), the pixel is scaled to
/// that bound. Sigma is what the halves differ by; where the pixel is over twice as bright as all about it,
/// at least the relative noise of the 25x25 pixels there: two samples of a half now and then both meet one.
/// Returns what was taken out, as part of X (3 planes); empty when nothing was. Only brightness of valid
/// pixels is judged. Differences of light are left alone: they are mostly near 0, so that all they have to
/// say would stand out. Source: Cycles' filter_prefilter. Threads: identical for any pool.
Planes SuppressFireflies(Halves* halves, TaskPool* pool);

/// Spreads what SuppressFireflies() took out over what is lit alike on the same surface nearby, so that the
/// layer keeps its energy and the dark beside a bright spot stays dark. `light`: the layer free of noise, as
/// Stabilise() gives it; `geometry`: features. All of the layer's size. Threads: identical for any pool.
Planes SpreadRemoved(const Planes& removed, const Planes& light, const Planes& geometry,
                     ConstFloatView weight, TaskPool* pool);

}  // namespace lumifold::filter
