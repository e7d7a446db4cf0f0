#pragma once

#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::charts {

/// Gaussian blur, truncated at three sigma. At the picture's edge the weights inside are renormalised.
/// Threads: the result is identical for any pool.
class Gaussian {
 public:
  /// sigma_px 0 is the identity.
  Gaussian(float sigma_px, int width, int height);

  Plane Mean(const Plane& values, TaskPool* pool) const { return Convolve(values, columns_, rows_, pool); }
  /// The variance of Mean() of independent values with these variances: the sum with squared weights.
  Plane VarianceOfMean(const Plane& variances, TaskPool* pool) const {
    return Convolve(variances, squared_columns_, squared_rows_, pool);
  }
  /// The weight of the pixel itself in its mean.
  float CentreWeight(int x, int y) const { return columns_.At(radius_, x) * rows_.At(radius_, y); }

 private:
  /// 2 radius + 1 weights for each position along an axis; 0 outside the picture.
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
