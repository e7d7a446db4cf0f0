#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// The most features PatchRegression takes.
inline constexpr size_t kMostRegressionFeatures = 12;

/// What patches are fitted and weighed by.
struct RegressionInput {
  const Planes& image;     // 3 planes: what is fitted
  const Planes& guide;     // 3 planes about 1: whose patches weigh, as in NonLocalMeans()
  const Planes& variance;  // 3 planes >= 0: of the guide
  const Planes& features;  // of variance about 1
  float strength = 1;      // k, as in NonLocalMeansParams
};

/// Fits image = c + c_x dx + c_y dy + c_f . (f_q - f_p) to the 19x19 pixels q around each pixel p, weighed by
/// how alike the 7x7 patches of the guide are, and gives for each pixel the mean, so weighed, of what all
/// fits around it say of it. Every coefficient but the constant has a ridge.
/// Shapes:  all planes W x H, finite; result: 3 planes.
/// Edges:   patches are clamped; pixels outside the picture give nothing.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Bitterli et al. 2016, section 5.2; Moon et al. 2014.
Planes PatchRegression(const RegressionInput& input, TaskPool* pool);

}  // namespace lumifold::filter
