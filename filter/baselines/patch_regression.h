#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The most features that PatchRegression accepts.
inline constexpr size_t kMostRegressionFeatures = 12;

/// The planes of a regression.
struct RegressionInput {
  const Planes& image;     // 3 planes: the values to fit
  const Planes& guide;     // 3 planes about 1: its patches give the weights, as in NonLocalMeans()
  const Planes& variance;  // 3 planes >= 0: variance of the guide
  const Planes& features;  // of variance about 1
  float strength = 1;      // k, as in NonLocalMeansParams
};

/// Fits image = c + c_x dx + c_y dy + c_f . (f_q - f_p) to the 19x19 pixels q around each pixel p, weighted
/// by the similarity of the 7x7 patches of the guide. The result at a pixel is the mean of the predictions of
/// all fits around it, with the same weights. Every coefficient except the constant has a ridge.
/// Shapes:  all planes W x H, finite; result: 3 planes.
/// Edges:   patches are clamped; pixels outside the picture are skipped.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Bitterli et al. 2016, section 5.2; Moon et al. 2014.
Planes PatchRegression(const RegressionInput& input, TaskPool* pool);

}  // namespace lumifold::filter
