#pragma once

#include <cstddef>

#include "filter/kernels/kernel_constants.h"

namespace lumifold::filter {

// Constants of the algorithm, shared by the filter and its oracle.

/// Weight of a cluster in a cell, in pixels, below which it has no mean there.
inline constexpr float kLeastClusterMass = 1e-12f;
/// Weight of the parent's manifold beside that of a cluster, in pixels. A cell that the cluster hardly
/// reaches takes the parent's; so a pixel that rounding puts into the other one of two clusters, being on
/// their seam, changes neither.
inline constexpr float kParentMass = 1e-5f;
/// Added to the sum of a pixel's weights where its mass is divided by it: pixels beyond all manifolds fade
/// out.
inline constexpr float kLeastTotal = 1e-15f;
/// Sum of a pixel's weights over all manifolds below which it keeps its own signal.
inline constexpr float kLeastWeight = 1e-20f;
/// Sigma of the blur along a manifold in feature units: sigma_r / sqrt(2), sigma_r = 1.
inline constexpr float kBlurRange = 0.70710678f;
/// Mean squared distance of a cluster's cells from its manifold below which their principal axis is rounding
/// noise.
inline constexpr double kLeastSpread = 1e-6;
/// Approximate number of rows of cells that the axis of a cluster is measured on: all rows of a small
/// picture, evenly spaced rows of a large one.
inline constexpr int kAxisRows = 64;
/// Standard deviations of its samples from their mean at which a fitted plane is read at most.
inline constexpr float kMostDeviations = 3;
/// Component k of the start vector of power iteration: fixed, so that results repeat, and parallel to no
/// feature.
inline double StartComponent(size_t k) {
  return (k % 2 == 0 ? 0.5 : -0.5) * (1.0 + 0.13 * static_cast<double>(k));
}

}  // namespace lumifold::filter
