#include "filter/manifold/recursive.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr float kSqrt2 = 1.41421356f;

/// to += weight * (from - to), weight one number for the row.
void PullRow(float weight, const float* __restrict from, float* __restrict to, int width) {
  for (int x = 0; x < width; ++x) to[x] += weight * (from[x] - to[x]);
}

/// The same with a weight for each pixel.
void PullRow(const float* __restrict weight, const float* __restrict from, float* __restrict to, int width) {
  for (int x = 0; x < width; ++x) to[x] += weight[x] * (from[x] - to[x]);
}

/// Forward and backward along kChains rows; weight(x) links x - 1 and x in all of them. Each row is a chain
/// of dependent steps, and several together hide each other's latency.
template <size_t kChains, typename Weight>
void RecurseChains(float* const* first_row, Weight weight, int width) {
  std::array<float*, kChains> rows;
  std::copy_n(first_row, kChains, rows.begin());
  for (int x = 1; x < width; ++x) {
    const float w = weight(x);
    for (float* row : rows) row[x] += w * (row[x - 1] - row[x]);
  }
  for (int x = width - 2; x >= 0; --x) {
    const float w = weight(x + 1);
    for (float* row : rows) row[x] += w * (row[x + 1] - row[x]);
  }
}

/// The same for any number of rows.
template <typename Weight>
void RecurseAlongRows(const std::vector<float*>& rows, Weight weight, int width) {
  size_t first = 0;
  for (; first + 8 <= rows.size(); first += 8) RecurseChains<8>(&rows[first], weight, width);
  for (; first + 4 <= rows.size(); first += 4) RecurseChains<4>(&rows[first], weight, width);
  for (; first < rows.size(); ++first) RecurseChains<1>(&rows[first], weight, width);
}

/// weight[x] of the link between cell x of `row` and the cell that `neighbour` has there.
void LinkWeights(float sigma, float range, const std::vector<const float*>& rows,
                 const std::vector<const float*>& neighbours, int width, float* __restrict weight) {
  std::fill_n(weight, width, 0.0f);
  for (size_t k = 0; k < rows.size(); ++k) {
    const float* row = rows[k];
    const float* neighbour = neighbours[k];
    for (int x = 0; x < width; ++x) {
      const float difference = row[x] - neighbour[x];
      weight[x] += difference * difference;
    }
  }
  const float stretch = (sigma / range) * (sigma / range);
  for (int x = 0; x < width; ++x) weight[x] = Exp(-kSqrt2 / sigma * std::sqrt(1.0f + stretch * weight[x]));
}

void GuidedRows(float sigma, float range, const Planes& guide, Planes* signals) {
  const int width = guide[0].width();
  std::vector<float> weight(static_cast<size_t>(width));
  std::vector<const float*> here(guide.size());
  std::vector<const float*> left(guide.size());
  std::vector<float*> rows(signals->size());
  for (int y = 0; y < guide[0].height(); ++y) {
    for (size_t k = 0; k < guide.size(); ++k) {
      here[k] = guide[k].Row(y) + 1;
      left[k] = guide[k].Row(y);
    }
    LinkWeights(sigma, range, here, left, width - 1, weight.data() + 1);
    for (size_t c = 0; c < signals->size(); ++c) rows[c] = (*signals)[c].Row(y);
    RecurseAlongRows(
        rows, [&weight](int x) { return weight[static_cast<size_t>(x)]; }, width);
  }
}

void GuidedColumns(float sigma, float range, const Planes& guide, Planes* signals) {
  const int width = guide[0].width();
  const int height = guide[0].height();
  Plane weights(width, height);  // row y: the links between rows y - 1 and y
  std::vector<const float*> here(guide.size());
  std::vector<const float*> above(guide.size());
  for (int y = 1; y < height; ++y) {
    for (size_t k = 0; k < guide.size(); ++k) {
      here[k] = guide[k].Row(y);
      above[k] = guide[k].Row(y - 1);
    }
    LinkWeights(sigma, range, here, above, width, weights.Row(y));
    for (Plane& signal : *signals) PullRow(weights.Row(y), signal.Row(y - 1), signal.Row(y), width);
  }
  for (int y = height - 2; y >= 0; --y) {
    for (Plane& signal : *signals) PullRow(weights.Row(y + 1), signal.Row(y + 1), signal.Row(y), width);
  }
}

}  // namespace

void LowPass(float sigma, Plane* plane) {
  const float weight = Exp(-kSqrt2 / sigma);
  const int width = plane->width();
  const int height = plane->height();
  std::vector<float*> rows;
  for (int y = 0; y < height; ++y) rows.push_back(plane->Row(y));
  RecurseAlongRows(
      rows, [weight](int) { return weight; }, width);
  for (int y = 1; y < height; ++y) PullRow(weight, plane->Row(y - 1), plane->Row(y), width);
  for (int y = height - 2; y >= 0; --y) PullRow(weight, plane->Row(y + 1), plane->Row(y), width);
}

void GuidedLowPass(float sigma, float range, const Planes& guide, Planes* signals) {
  GuidedRows(sigma, range, guide, signals);
  GuidedColumns(sigma, range, guide, signals);
}

}  // namespace lumifold::filter
