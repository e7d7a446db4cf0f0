#pragma once

#include <cstddef>

namespace lumifold::filter {

/// Floats of which a FitRows::row is a multiple.
inline constexpr size_t kFitRowPadding = 8;

/// Samples of a weighted regression: for each a row of numbers, of which the terms follow the signals.
struct FitRows {
  const float* rows;      // `row` floats of each sample, a multiple of kFitRowPadding
  const float* weighted;  // `terms` floats of each: its terms times its weight
  size_t count;
  size_t row;
  size_t signals;
  size_t terms;
};

/// The sums of a regression's normal equations: sums[i * row + k] += weighted[i] * rows[k], sample after
/// sample. The matrix is symmetric: for term i, numbers behind it are added or left out.
/// Threads: safe concurrently. The bits are those of fit.cl, with any vectors.
void AddFitRows(const FitRows& samples, float* sums);

/// Samples that follow each other, and one that they are compared with.
struct LikeArgs {
  const float* numbers;  // number k of sample i at numbers[k * stride + i]: traits, x, y
  size_t stride;
  size_t traits;        // a multiple of 4
  size_t first, count;  // of the samples; kLikePadding floats after the last number of all may be read
  size_t centre;        // the one
  float falloff;        // squared distance of traits that counts as a distance of 1 px
  float most;           // squared distance from which on weights are 0
};

/// Floats that may be read (not used) after the numbers.
inline constexpr size_t kLikePadding = 16;
/// Samples that one call of LikenessOf takes at most; `weights` has so many floats.
inline constexpr size_t kMostLikenesses = 64;

/// weights[i] = max(0, 1 - d / most)^3 of sample first + i, where d is its squared distance: nearly a normal
/// curve, which falls to 0 without a step, so that rounding changes no sum by much.
/// Threads: safe concurrently. The bits are those of fit.cl, with any vectors.
void LikenessOf(const LikeArgs& args, float* weights);

}  // namespace lumifold::filter
