#pragma once

#include <cstdint>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// The squared error of a filtered picture falls as samples^-kErrorDecline: between noise, which falls as 1 / samples, and
/// bias. 0.65 to 0.83 in the chart's scenes (docs/results/adaptive.md).
inline constexpr float kErrorDecline = 0.75f;

/// Variance of the logarithm of a block's estimate, for blocks of 4x4 pixels: that of a mean of two or three independent
/// squares, because the filter correlates the errors of neighbours. From 0.7 to 1.3 the chart's scenes need the same samples
/// within 3 %.
inline constexpr double kLogVarianceOfBlock = 0.7;

/// What is left of it once blocks are drawn towards those of the same noise and detail, whose own logarithms vary about as
/// much.
inline constexpr double kLogVarianceOfDrawnBlock = 0.5;

/// The whole error over its variance where cross-validation tells nothing more: geometric mean over the chart's scenes
/// (docs/results/adaptive.md). Samples that lie where errors look large leave more error elsewhere than estimates tell.
inline constexpr double kUsualBiasFactor = 1.15;

/// Which squared error is estimated: that of Mse255 or of RelMse. The curve of Mse255 is replaced by its slope at the
/// filtered value.
enum class ErrorMetric { kMse255, kRelMse };

/// A film, and what the filter made of it.
struct FilteredFilm {
  const LayeredImage& film;  // with noisy, noisy_a, noisy_b, samples_a.Y and samples_b.Y
  ConstColorView picture;
};

/// Estimated squared error of a filtered picture, without a reference.
struct ErrorEstimate {
  int columns = 0;  // of blocks
  int rows = 0;
  /// Mean over the pixels and channels of each block, row by row; the error at the later film's counts. Negative where
  /// the block has no new samples.
  std::vector<double> blocks;
  /// By what cross-validation has scaled them: the error over the variance, at least 1.
  double bias_factor = kUsualBiasFactor;
};

/// Compares what the filter makes of a film with what it made of the same film when it had fewer samples.
///
/// Variance, block by block: the filtered picture is nearly a mean of the samples, so that of n samples, m of which the
/// earlier film had, the mean square of the two pictures' difference is V(m) - V(n). V falls as n^-kErrorDecline, so
/// V(n) = difference^2 / ((n / m)^kErrorDecline - 1).
/// Bias, over the whole picture: the earlier picture has seen none of the new samples, so the mean square of its
/// difference from their mean, less the variance of that mean, is its whole error. That is without bias but far noisier
/// than V; so it gives one factor on all blocks, which is as far from the usual one as its standard error allows.
/// Precision: a block has few independent errors, so its estimate is drawn towards what blocks of the same noise and detail
/// have: a plane fitted through the logarithms of estimate, noise and detail over all blocks. Detail is the filtered
/// picture's variance within the block, since errors gather at edges. The more the blocks vary around the plane beyond
/// kLogVarianceOfBlock, the less (empirical Bayes). The mean over the picture stays.
/// Shapes:  both W x H; each pixel of `later` has at least as many samples as in `earlier`, which are among them.
///          Blocks are squares of `block` pixels, smaller at the right and lower border.
/// Units:   squared 8-bit steps, or relative.
/// Threads: identical for any pool.
/// Source:  the variance is Gruzdev's halves taken over time; cross-validation with new samples is our own.
ErrorEstimate EstimateError(const FilteredFilm& earlier, const FilteredFilm& later, int block,
                            ErrorMetric metric, TaskPool* pool);

}  // namespace lumifold::metrics
