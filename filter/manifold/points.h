#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/image/parallel.h"
#include "filter/manifold/lattice.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/manifold_tree.h"

namespace lumifold::filter {

/// Weights of all points on the manifolds of a level: w of point p on manifold i at [p * stride + i], p =
/// pixel * samples + sample, in the order of SlicePoints::weights.
struct PointWeights {
  size_t stride = 0;  // manifolds, padded
  std::vector<float> values;
};

/// The points of one run of the filter, and the cells they are read from. Each pixel of points reads all
/// planes of four cells, so these cells are packed first: the planes of a cell one after another.
/// Threads: const calls are safe concurrently; results are identical for any pool.
class Points {
 public:
  /// Refers to `points`. `features`: those of the pixels.
  Points(const SlicePoints& points, const Planes& features, const Lattice& lattice);

  /// exp(-squared distance between the points' features and each manifold).
  PointWeights Weigh(const std::vector<Manifold>& manifolds, TaskPool* pool) const;

  /// Adds the points' signals to the splats of a level: mass * w * signal, and mass * w, over the cell's
  /// area. `signals`: laid out as SlicePoints::signals, C channels; `masses`: as SlicePoints::weights.
  void Splat(const std::vector<float>& signals, const std::vector<float>& masses, const PointWeights& weights,
             TaskPool* pool, std::vector<Planes>* splats) const;

  /// Adds w * psi of a level's manifolds to the points' sums: values and weights, laid out as in
  /// SlicedPoints.
  /// Source: Gruzdev et al. 2015, antialiasing.
  void Slice(const std::vector<Planes>& psi, const PointWeights& weights, TaskPool* pool,
             SlicedPoints* sums) const;

 private:
  /// Consecutive entries of SlicePoints::pixels that are of one pixel: what is read from cells is the same
  /// for all.
  struct Run {
    size_t first;
    size_t last;
    std::array<uint32_t, 4> corners;  // packed cells around the pixel: the upper two, the lower two
    float column_part;                // of the way from left to right
    float row_part;                   // and from top to bottom
    uint32_t own;                     // packed cell of the pixel
    float area;                       // of that, pixels
  };

  /// Planes of the cells that points are read from.
  struct Packed {
    size_t stride = 0;  // floats of a cell
    std::vector<float> cells;
  };

  /// Calls body(first, last) for ranges of cells_.
  void ForEachCells(TaskPool* pool, absl::FunctionRef<void(size_t, size_t)> body) const;
  /// Packs plane k of the i-th of `sets` sets of planes at [k * pitch + i] of each cell.
  Packed Pack(size_t sets, absl::FunctionRef<const Planes&(size_t)> planes_of, size_t pitch,
              TaskPool* pool) const;
  /// All floats of a cell at the pixel of a run, bilinearly.
  static void Read(const Packed& packed, const Run& run, float* values);
  void WeighRun(size_t run, const Packed& eta, size_t lanes, float* scratch, float* weights) const;
  void SplatRun(const Run& run, const std::vector<float>& signals, const std::vector<float>& masses,
                const PointWeights& weights, Packed* splats) const;
  void SliceRun(const Run& run, const Packed& psi, size_t manifold, size_t channels,
                const PointWeights& weights, float* scratch, SlicedPoints* sums) const;

  const SlicePoints& points_;
  size_t shared_features_;  // those of the pixel
  std::vector<Run> runs_;
  std::vector<std::array<int, 2>> cells_;    // column and row of each that is packed
  std::vector<float> pixel_features_;        // the shared ones, run by run
  std::vector<std::vector<size_t>> by_row_;  // runs by the row of their own cell
};

}  // namespace lumifold::filter
