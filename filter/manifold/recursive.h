#pragma once

#include <vector>

#include "absl/types/span.h"
#include "filter/manifold/bands.h"

namespace lumifold::filter {

/// Low-pass h(x, sigma): a first-order recursion forward and then backward on the forward result, along rows
/// and then columns, in place. Its answer to an impulse is symmetric away from the edges. sigma in cells, >
/// 0.
void LowPass(float sigma, Plane* plane);

/// The same recursion on all `signals` at once, its weight between neighbouring cells lowered where `guide`
/// changes: a^sqrt(1 + (sigma/range)^2 |dguide|^2), a = exp(-sqrt(2)/sigma). Gives the signals blurred with
/// each of `sigmas`. Threads: identical for any pool. Source: Gastal & Oliveira 2011, recursive filter, one
/// iteration.
std::vector<Planes> GuidedLowPass(absl::Span<const float> sigmas, float range, const Planes& guide,
                                  const Planes& signals, TaskPool* pool);

}  // namespace lumifold::filter
