#pragma once

#include "filter/image/planes.h"

namespace lumifold::filter {

/// Low-pass h(x, sigma): a first-order recursion forward, then backward on the forward result, along rows and
/// then columns, in place. Its impulse response is symmetric away from the edges.
/// Units:  sigma in cells, > 0.
/// Source: Gastal & Oliveira 2012, h of Eq. (7) and (8).
void LowPass(float sigma, Plane* plane);

/// The same recursion on all `signals` at once. Its feedback coefficient between neighbouring cells falls
/// where `guide` changes: a^sqrt(1 + (sigma/range)^2 |dguide|^2), a = exp(-sqrt(2)/sigma).
/// Units:   sigma in cells, range in units of the guide.
/// Threads: identical for any pool.
/// Source:  blurring of Gastal & Oliveira 2012 by the recursive filter of Gastal & Oliveira 2011, one
///          iteration.
Planes GuidedLowPass(float sigma, float range, const Planes& guide, const Planes& signals, TaskPool* pool);

}  // namespace lumifold::filter
