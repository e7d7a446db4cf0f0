#pragma once

#include <vector>

#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

// Constants of the algorithm, shared with its oracle.

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
/// Component k of the vector that power iteration starts from: fixed, so that results repeat, and along no
/// axis.
inline double StartComponent(size_t k) {
  return (k % 2 == 0 ? 0.5 : -0.5) * (1.0 + 0.13 * static_cast<double>(k));
}

/// One manifold, on the coarse grid.
struct Manifold {
  Planes eta;               // its height in each feature
  std::vector<float> axis;  // the direction that splits its cluster in two
};

/// What a cluster leaves on the coarse grid: mean over each cell's pixels of weight * u, and of the weight.
struct ClusterSums {
  Planes weighted;
  Plane weight;
};

ClusterSums MakeClusterSums(size_t features, const Lattice& lattice);

/// The manifold through a cluster: low-passed weighted features over low-passed weight; `parent`'s height
/// where there is no weight (0 when parent is null). Its axis: `iterations` steps of power iteration on the
/// cells' covariance about the manifold; left empty for 0.
Manifold MakeManifold(const ClusterSums& sums, const Planes* parent, float sigma_cells, int iterations);

}  // namespace lumifold::filter
