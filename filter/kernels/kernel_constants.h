#pragma once

namespace lumifold::filter {

// Constants of the manifold filter that its kernels and their oracles share.

inline constexpr float kSqrt2 = 1.41421356f;
/// Squared distance from a manifold at which a pixel's weight becomes 0: products of two weights stay above
/// denormals.
inline constexpr float kFarthest = 40.0f;
/// Distance in feature units from the plane that splits a cluster within which pixels fade out of both parts,
/// so that rounding, which puts them on one side or the other, does not show in the result.
inline constexpr float kSeam = 0.3f;

}  // namespace lumifold::filter
