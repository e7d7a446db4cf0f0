#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::charts {

/// Means over pixels with Gaussian weights out to three sigma, those of pixels outside the picture shared out
/// among the others. Threads: identical for any pool.
class Gaussian {
 public:
  /// sigma_px 0 leaves everything as it is.
  Gaussian(float sigma_px, int width, int height);

  Plane Mean(const Plane& values, TaskPool* pool) const { return Convolve(values, columns_, rows_, pool); }
  /// The variance of Mean() of values with these variances that know nothing of each other: the sum with
  /// squared weights.
  Plane VarianceOfMean(const Plane& variances, TaskPool* pool) const {
    return Convolve(variances, squared_columns_, squared_rows_, pool);
  }
  /// The pixel's own weight in its mean.
  float CentreWeight(int x, int y) const { return columns_.At(radius_, x) * rows_.At(radius_, y); }

 private:
  /// (2 radius + 1) weights for each place along an axis, 0 outside it.
  static Plane Weights(float sigma_px, int radius, int length);
  static Plane Squared(const Plane& weights);
  Plane Convolve(const Plane& values, const Plane& columns, const Plane& rows, TaskPool* pool) const;

  int radius_;
  Plane columns_;
  Plane rows_;
  Plane squared_columns_;
  Plane squared_rows_;
};

}  // namespace lumifold::charts
