#include "filter/kernels/box_mean.h"

#include <algorithm>
#include <vector>

#include "filter/kernels/window_sums.h"

namespace lumifold::filter {
namespace {

/// One block of all means.
void BlockMeans(const Rect& block, const Planes& values, ConstFloatView weight, WindowSums<1>* window,
                Planes* means) {
  const Rect picture = {0, 0, weight.width(), weight.height()};
  const int width = block.width();
  std::vector<float> mass;
  window->Take(block, picture, [&](int y, int x0, int x1, const auto& rows) {
    std::copy_n(weight.Row(y) + x0, x1 - x0, rows[0]);
  });
  for (int y = block.y0; y < block.y1; ++y) {
    const float* sums = window->Row(y)[0];
    mass.insert(mass.end(), sums, sums + width);
  }
  for (size_t i = 0; i < values.size(); ++i) {
    window->Take(block, picture, [&](int y, int x0, int x1, const auto& rows) {
      std::fill_n(rows[0], x1 - x0, 0.0f);
      AddProductRow(values[i].Row(y) + x0, weight.Row(y) + x0, x1 - x0, rows[0]);
    });
    for (int y = block.y0; y < block.y1; ++y) {
      const float* __restrict sum = window->Row(y)[0];
      const float* __restrict by = mass.data() + static_cast<std::ptrdiff_t>(y - block.y0) * width;
      float* __restrict mean = (*means)[i].Row(y) + block.x0;
      for (int x = 0; x < width; ++x) {
        const float quotient = sum[x] / by[x];
        mean[x] = by[x] > 0 ? quotient : 0.0f;
      }
    }
  }
}

}  // namespace

Planes BoxMeans(const Planes& values, ConstFloatView weight, int radius, TaskPool* pool) {
  const int width = weight.width();
  // A window over the whole picture reaches no further.
  const int reach = std::min(radius, std::max(width, weight.height()));
  Planes means = MakeUninitializedPlanes(values.size(), width, weight.height());
  ForEachBand(pool, weight.height(), [&](int, int y0, int y1) {
    WindowSums<1> window(reach);
    for (int x0 = 0; x0 < width; x0 += window.kColumns)
      BlockMeans({x0, y0, std::min(x0 + window.kColumns, width), y1}, values, weight, &window, &means);
  });
  return means;
}

}  // namespace lumifold::filter
