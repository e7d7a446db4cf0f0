#pragma once

#include "filter/image/planes.h"

namespace lumifold::filter {

/// Low-pass h(x, sigma): a first-order recursion forward and then backward on the forward result, along rows
/// and then columns, in place. Its answer to an impulse is symmetric away from the edges. sigma in cells, >
/// 0.
void LowPass(float sigma, Plane* plane);

/// The same recursion on all `signals` at once, its weight between neighbouring cells lowered where `guide`
/// changes: a^sqrt(1 + (sigma/range)^2 |dguide|^2), a = exp(-sqrt(2)/sigma). Threads: identical for any pool.
/// Source: Gastal & Oliveira 2011, recursive filter, one iteration.
Planes GuidedLowPass(float sigma, float range, const Planes& guide, const Planes& signals, TaskPool* pool);

}  // namespace lumifold::filter
