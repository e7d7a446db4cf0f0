#pragma once

#include <algorithm>

namespace lumifold::render {

/// Russian roulette: the probability with which a path goes on from a vertex is this times its throughput.
/// Paths that go on count for those that do not: the mean of a picture is the same with any factor, noise and
/// time are not. The factor of least equal-time error (EARS) is the root of (1 + 1/V) C/c, if light is
/// alike at all vertices: V is the variance of a sample over its squared mean, about 1; C is what a sample
/// costs and c what the rest of the path does, which is less. 1 has 1.04 times the equal-time error of 1.5;
/// 2 has the same for more rays a sample (docs/results/render-speed.md).
/// Sources: Arvo & Kirk 1990; Rath et al. 2022, EARS.
inline constexpr float kRouletteFactor = 1.5f;

/// The factor at vertex number `vertex`, the camera's surface being 0; 0: the path goes on.
inline float RouletteFactor(int vertex) { return vertex >= 2 ? kRouletteFactor : 0.0f; }

/// The probability. `throughput` estimates that of the path after the next step, its greatest channel. It is
/// relative to what the camera's surface scatters, because noise counts relative to the light of its pixel.
inline float SurvivalProbability(int vertex, float throughput) {
  const float factor = RouletteFactor(vertex);
  return factor > 0 ? std::min(1.0f, factor * throughput) : 1.0f;
}

}  // namespace lumifold::render
