#pragma once

#include <cstddef>

namespace lumifold::filter {

// Constants of the algorithm, shared by the filter, its kernels and their oracles.

inline constexpr float kSqrt2 = 1.41421356f;
/// A cell with less of a cluster than this (in pixels' weights) takes its parent's manifold.
inline constexpr float kLeastClusterMass = 1e-12f;
/// Squared distance from a manifold at which a pixel's weight becomes 0: below e^-23 it could only bring
/// denormals.
inline constexpr float kFarthest = 23.0f;
/// A pixel that all manifolds together weigh less than this keeps its own signal.
inline constexpr float kLeastWeight = 1e-20f;
/// Sigma of the blur along a manifold in feature units: sigma_r / sqrt(2), sigma_r = 1.
inline constexpr float kBlurRange = 0.70710678f;
/// Mean squared distance of a cluster's cells from its manifold below which rounding alone gives them a
/// direction.
inline constexpr double kLeastSpread = 1e-6;
/// Pixels nearer than this to the plane that splits a cluster, in feature units, fade out of both parts:
/// which side rounding puts them on must not show in the result.
inline constexpr float kSeam = 0.3f;
/// Rows of cells that the axis of a cluster is measured on, about: all of a small picture, every so many of a
/// large one.
inline constexpr int kAxisRows = 64;
/// Component k of the vector that power iteration starts from: fixed, so that results repeat, and along no
/// axis.
inline double StartComponent(size_t k) {
  return (k % 2 == 0 ? 0.5 : -0.5) * (1.0 + 0.13 * static_cast<double>(k));
}

}  // namespace lumifold::filter
