#include "filter/manifold/box_mean.h"

#include <algorithm>

#include "filter/manifold/bands.h"

namespace lumifold::filter {
namespace {

void AddRow(const float* __restrict from, float* __restrict to, int width) {
  for (int x = 0; x < width; ++x) to[x] += from[x];
}

/// sums[x] = values[x - radius] + ... + values[x + radius], as far as there are any.
void SumAlongRow(const float* values, int width, int radius, float* sums) {
  std::fill_n(sums, width, 0.0f);
  const int reach = std::min(radius, width - 1);
  for (int offset = -reach; offset <= reach; ++offset) {
    const int x0 = std::max(0, -offset);
    const int x1 = std::min(width, width - offset);
    AddRow(values + x0 + offset, sums + x0, x1 - x0);
  }
}

}  // namespace

Plane BoxMean(ConstFloatView values, ConstFloatView weight, int radius, TaskPool* pool) {
  const int width = values.width();
  const int height = values.height();
  Plane value_sums(width, height);
  Plane weight_sums(width, height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    std::vector<float> product(static_cast<size_t>(width));
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x) product[static_cast<size_t>(x)] = values.At(x, y) * weight.At(x, y);
      SumAlongRow(product.data(), width, radius, value_sums.Row(y));
      SumAlongRow(weight.Row(y), width, radius, weight_sums.Row(y));
    }
  });
  Plane mean(width, height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    std::vector<float> total(static_cast<size_t>(width));
    for (int y = y0; y < y1; ++y) {
      std::fill(total.begin(), total.end(), 0.0f);
      for (int row = std::max(0, y - radius); row <= std::min(height - 1, y + radius); ++row) {
        AddRow(value_sums.Row(row), mean.Row(y), width);
        AddRow(weight_sums.Row(row), total.data(), width);
      }
      for (int x = 0; x < width; ++x) {
        const float sum = total[static_cast<size_t>(x)];
        mean.At(x, y) = sum > 0 ? mean.At(x, y) / sum : 0.0f;
      }
    }
  });
  return mean;
}

}  // namespace lumifold::filter
