#pragma once

#include <cstddef>

namespace lumifold::filter {

// The inner loops of the recursive low-passes (recursive.h), by the rules of row_kernels.h: the same bits
// with any vectors, each with an oracle in namespace slow (recursion_kernels_slow.cc) that it equals to the
// last bit. All are safe to run side by side.

/// Rows of cells of some signals. from and to may be the same.
struct RecurseArgs {
  const float* const* from;  // row r of signal s at [s * rows + r]
  float* const* to;          // laid out alike
  size_t signals;
  size_t rows;
  int count;  // cells of a row, >= 1
};

/// For each row: to[x] = from[x] + w (to[x - 1] - from[x]) from the left, then to[x] += w' (to[x + 1] -
/// to[x]) from the right, where w is what links x - 1 and x, and w' what links x and x + 1. `weights`: for
/// each row of any signal the link of each x with x - 1.
void RecurseRows(const RecurseArgs& args, const float* const* weights);
/// The same where all links are `weight`.
void RecurseRowsEvenly(const RecurseArgs& args, float weight);
/// to[x] += weight[x] * (from[x] - to[x]).
void PullRow(const float* weight, const float* from, int count, float* to);
/// The same where all weights are `weight`.
void PullRowEvenly(float weight, const float* from, int count, float* to);

/// Rows of cells that are linked: cell x of `here` with cell x of `there`, `planes` rows each.
struct LinkArgs {
  const float* const* here;
  const float* const* there;
  size_t planes;
  int count;
};
/// How far a blur reaches: its sigma in cells, and what it multiplies squared distances by.
struct LinkReach {
  float sigma;
  float stretch;
};
/// weights[x] = exp(-sqrt(2)/sigma sqrt(1 + stretch |here - there|^2)).
void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights);

namespace slow {
void RecurseRows(const RecurseArgs& args, const float* const* weights);
void RecurseRowsEvenly(const RecurseArgs& args, float weight);
void PullRow(const float* weight, const float* from, int count, float* to);
void PullRowEvenly(float weight, const float* from, int count, float* to);
void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights);
}  // namespace slow

}  // namespace lumifold::filter
