#pragma once

#include <cstddef>

namespace lumifold::filter {

// The inner loops of recursive low-pass filters, by the rules of row_kernels.h: the same bits with any vector
// width, each equal to the last bit to an oracle of the tests. All are safe to run concurrently.

/// Rows of cells of some signals. from and to may be the same.
struct RecurseArgs {
  const float* const* from;  // row r of signal s at [s * rows + r]
  float* const* to;          // same layout
  size_t signals;
  size_t rows;
  int count;  // cells of a row, >= 1
};

/// For each row: to[x] = from[x] + w (to[x - 1] - from[x]) from the left, then to[x] += w' (to[x + 1] -
/// to[x]) from the right. w is the feedback coefficient between x - 1 and x, w' that between x and x + 1.
/// `weights`: for each row, shared by all signals, the coefficient between x - 1 and x at x.
void RecurseRows(const RecurseArgs& args, const float* const* weights);
/// The same with one coefficient, `weight`.
void RecurseRowsEvenly(const RecurseArgs& args, float weight);
/// to[x] += weight[x] * (from[x] - to[x]).
void PullRow(const float* weight, const float* from, int count, float* to);
/// The same with one weight.
void PullRowEvenly(float weight, const float* from, int count, float* to);

/// Two neighbouring rows of cells of the guide: cell x of `here` and cell x of `there`, `planes` rows each.
struct LinkArgs {
  const float* const* here;
  const float* const* there;
  size_t planes;
  int count;
};
/// Width of a blur: its sigma in cells, and the factor on squared differences of the guide.
struct LinkReach {
  float sigma;
  float stretch;
};
/// weights[x] = exp(-sqrt(2)/sigma sqrt(1 + stretch |here - there|^2)).
void LinkRow(const LinkArgs& args, const LinkReach& reach, float* weights);
/// The same bits a cell at a time, for rows that are narrower than a vector.
void LinkNarrowRow(const LinkArgs& args, const LinkReach& reach, float* weights);

}  // namespace lumifold::filter
