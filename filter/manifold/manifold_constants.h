#pragma once

#include <cstddef>

#include "filter/kernels/kernel_constants.h"

namespace lumifold::filter {

// Constants of the algorithm, shared by the filter and its oracle.

/// A cell with less of a cluster than this (in pixels' weights) takes its parent's manifold.
inline constexpr float kLeastClusterMass = 1e-12f;
/// A pixel that all manifolds together weigh less than this keeps its own signal.
inline constexpr float kLeastWeight = 1e-20f;
/// Sigma of the blur along a manifold in feature units: sigma_r / sqrt(2), sigma_r = 1.
inline constexpr float kBlurRange = 0.70710678f;
/// Mean squared distance of a cluster's cells from its manifold below which rounding alone gives them a
/// direction.
inline constexpr double kLeastSpread = 1e-6;
/// Rows of cells that the axis of a cluster is measured on, about: all of a small picture, every so many of a
/// large one.
inline constexpr int kAxisRows = 64;
/// Component k of the vector that power iteration starts from: fixed, so that results repeat, and along no
/// axis.
inline double StartComponent(size_t k) {
  return (k % 2 == 0 ? 0.5 : -0.5) * (1.0 + 0.13 * static_cast<double>(k));
}

}  // namespace lumifold::filter
