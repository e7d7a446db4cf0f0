#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/splat.h"

namespace lumifold::filter {

/// Weights of all points on the manifolds of a level: w of point p on manifold i at [i][p], p = pixel * samples
/// + sample, in the order of SlicePoints::weights.
using PointWeights = std::vector<std::vector<float>>;

/// exp(-squared distance between the points' features and each manifold).
/// Threads: identical for any pool.
PointWeights WeighPoints(const PixelState& state, const std::vector<Manifold>& manifolds,
                         const SlicePoints& points, TaskPool* pool);

/// Adds the points' signals to the splats of a level: weight * w * signal, and weight * w, over the cell's area.
/// `signals`: laid out as SlicePoints::signals, C channels.
/// Threads: identical for any pool.
void SplatPoints(const PixelState& state, const SlicePoints& points, const std::vector<float>& signals,
                 const PointWeights& weights, TaskPool* pool, std::vector<Planes>* splats);

/// Adds w * psi of a level's manifolds to the points' sums: values and weights, laid out as in SlicedPoints.
/// Threads: identical for any pool.
/// Source: Gruzdev et al. 2015, antialiasing.
void SlicePointsAt(const PixelState& state, const std::vector<Planes>& psi, const SlicePoints& points,
                   const PointWeights& weights, TaskPool* pool, SlicedPoints* sums);

}  // namespace lumifold::filter
