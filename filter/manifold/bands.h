#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/types/span.h"
#include "filter/image/parallel.h"
#include "filter/image/plane.h"

namespace lumifold::filter {

/// Several channels of one size.
using Planes = std::vector<Plane>;

/// Rows a task works on. Sums over pixels are formed per band and added in band order, so that no result
/// depends on the pool; therefore this is part of the result's definition, not a tuning knob.
inline constexpr int kBandRows = 64;

inline int BandCount(int height) { return (height + kBandRows - 1) / kBandRows; }

/// Calls body(band, y0, y1) for each band of rows.
inline void ForEachBand(TaskPool* pool, int height, absl::FunctionRef<void(int, int, int)> body) {
  ParallelFor(pool, BandCount(height), [&](int64_t band) {
    const int y0 = static_cast<int>(band) * kBandRows;
    body(static_cast<int>(band), y0, std::min(y0 + kBandRows, height));
  });
}

/// The sum of row_sum(y) over all rows, added in a fixed order.
inline double SumRows(TaskPool* pool, int height, absl::FunctionRef<double(int)> row_sum) {
  std::vector<double> sums(static_cast<size_t>(BandCount(height)), 0.0);
  ForEachBand(pool, height, [&](int band, int y0, int y1) {
    for (int y = y0; y < y1; ++y) sums[static_cast<size_t>(band)] += row_sum(y);
  });
  double total = 0;
  for (const double sum : sums) total += sum;
  return total;
}

inline Planes MakePlanes(size_t count, int width, int height) {
  Planes planes;
  planes.reserve(count);
  for (size_t i = 0; i < count; ++i) planes.emplace_back(width, height);
  return planes;
}

/// The same, to be written before they are read: their values are anything.
inline Planes MakeUninitializedPlanes(size_t count, int width, int height) {
  Planes planes;
  planes.reserve(count);
  for (size_t i = 0; i < count; ++i) planes.push_back(Plane::Uninitialized(width, height));
  return planes;
}

/// sum += x, plane by plane.
inline void AddPlanes(absl::Span<const Plane> x, TaskPool* pool, absl::Span<Plane> sum) {
  ForEachBand(pool, sum[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < sum.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* __restrict in = x[c].Row(y);
        float* __restrict out = sum[c].Row(y);
        for (int i = 0; i < sum[c].width(); ++i) out[i] += in[i];
      }
    }
  });
}

/// Three planes as a colour.
inline ConstColorView ViewOf(const Planes& color) {
  return {color[0].view(), color[1].view(), color[2].view()};
}

}  // namespace lumifold::filter
