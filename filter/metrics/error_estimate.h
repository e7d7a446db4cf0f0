#pragma once

#include <cstdint>
#include <vector>

#include "filter/image/filtered_picture.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// The squared error of a filtered picture falls as samples^-kErrorDecline: between noise, which falls as 1 /
/// samples, and bias. 0.65 to 0.83 in the chart's scenes (docs/results/adaptive.md).
inline constexpr float kErrorDecline = 0.75f;

/// Variance of the logarithm of a block's estimate, for blocks of 2x2 pixels: that of a mean of three
/// independent squares, because the filter correlates the errors of neighbours. More drowns what is rare in
/// what is common: with 1.2 a caustic in a small picture gets 1.5 times the samples of plain walls, with 0.9
/// 1.6 times; three scenes err alike.
inline constexpr double kLogVarianceOfBlock = 0.9;

/// What is left of it once blocks are drawn towards those of the same traits, whose own logarithms vary about
/// as much.
inline constexpr double kLogVarianceOfDrawnBlock = 0.5;

/// The error of what the filter made of noise over the variance that its halves show: they share guides,
/// geometry, T, E and the filter's bias. 1.7 to 2.9 in films of the chart's scenes
/// (docs/decisions/0021-adaptive-sampling.md). It is 1 for noise that the filter left as it is.
inline constexpr double kErrorOverVariance = 2.2;

/// Which squared error is estimated: that of Mse255 or of RelMse.
enum class ErrorMetric { kMse255, kRelMse };

/// A film, and what the filter made of it.
struct FilteredFilm {
  const LayeredImage& film;             // with noisy_a, noisy_b, samples_a.Y and samples_b.Y
  const FilteredPicture& filtered;      // `returned` may be empty
  const LayeredImage* edges = nullptr;  // the film's edge set; null: unknown
};

/// Estimated squared error of a filtered picture, without a reference.
struct ErrorEstimate {
  int columns = 0;  // of blocks
  int rows = 0;
  /// Mean over the pixels and channels of each block, row by row. Negative where no pixel has samples of both
  /// halves.
  std::vector<double> blocks;
};

/// Estimates the error from the halves of the picture, which the filter makes each without the samples of the
/// other: the mean square of the deviation, with that of returned energy, times 1 + (kErrorOverVariance -
/// 1)(1 - r). r is the part of the film's variance that the picture still has: halves of what the filter left
/// alone share nothing. Over the picture the error is distributed as the squares of the deviation without
/// returned energy, because samples lower it there. Precision: a block has few independent errors, so its
/// estimate is drawn towards what blocks of the same traits have: a linear function fitted through the
/// logarithms over all blocks. The traits are the noise around the block, and, since errors gather at edges,
/// the filtered picture's variance within it and the parts of edge pixels in it and around it. The more the
/// blocks vary around the function beyond kLogVarianceOfBlock, the less (empirical Bayes). Before that a
/// pixel whose samples are all alike, though the filter changed it, is taken to err as what is around: it may
/// not have met what others have. The mean over the picture stays.
/// Shapes:  W x H. Blocks are squares of `block` pixels, smaller at the right and lower border.
/// Units:   squared 8-bit steps, or relative.
/// Threads: identical for any pool.
/// Source:  halves: Rousselle et al. 2012; drawing blocks together is our own.
ErrorEstimate EstimateError(const FilteredFilm& filtered, int block, ErrorMetric metric, TaskPool* pool);

}  // namespace lumifold::metrics
