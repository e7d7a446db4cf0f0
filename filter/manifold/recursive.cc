#include "filter/manifold/recursive.h"

#include <algorithm>

#include "filter/image/portable_math.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/manifold/row_kernels.h"

namespace lumifold::filter {
namespace {

constexpr int kRowsPerTask = 16;
constexpr int kColumnsPerTask = 128;

/// Rows of each plane, from column x0.
template <typename PlaneOf, typename Value>
void RowsAt(PlaneOf& planes, int y, int x0, std::vector<Value*>* rows) {
  for (size_t k = 0; k < rows->size(); ++k) (*rows)[k] = planes[k].Row(y) + x0;
}

float Stretch(float sigma, float range) { return (sigma / range) * (sigma / range); }

/// Rows [y0, y1), all of them together.
void GuidedRows(float sigma, float range, const Planes& guide, int y0, int y1, Planes* signals) {
  const int width = guide[0].width();
  Plane weights = Plane::Uninitialized(width, y1 - y0);  // column x: the links between columns x - 1 and x
  std::vector<const float*> here(guide.size());
  std::vector<const float*> left(guide.size());
  std::vector<float*> rows;
  for (int y = y0; y < y1; ++y) {
    RowsAt(guide, y, 1, &here);
    RowsAt(guide, y, 0, &left);
    LinkRow(sigma, Stretch(sigma, range), here.data(), left.data(), guide.size(), width - 1,
            weights.Row(y - y0) + 1);
    for (Plane& signal : *signals) rows.push_back(signal.Row(y));
  }
  std::vector<const float*> row_weights;
  for (size_t i = 0; i < rows.size(); ++i)
    row_weights.push_back(weights.Row(static_cast<int>(i / signals->size())));
  RecurseRows(rows.data(), row_weights.data(), rows.size(), width, rows.data());
}

/// Columns [x0, x1), all of them side by side.
void GuidedColumns(float sigma, float range, const Planes& guide, int x0, int x1, Planes* signals) {
  const int count = x1 - x0;
  const int height = guide[0].height();
  Plane weights = Plane::Uninitialized(count, height);  // row y: the links between rows y - 1 and y
  std::vector<const float*> here(guide.size());
  std::vector<const float*> above(guide.size());
  for (int y = 1; y < height; ++y) {
    RowsAt(guide, y, x0, &here);
    RowsAt(guide, y - 1, x0, &above);
    LinkRow(sigma, Stretch(sigma, range), here.data(), above.data(), guide.size(), count, weights.Row(y));
    for (Plane& signal : *signals) PullRow(weights.Row(y), signal.Row(y - 1) + x0, count, signal.Row(y) + x0);
  }
  for (int y = height - 2; y >= 0; --y) {
    for (Plane& signal : *signals)
      PullRow(weights.Row(y + 1), signal.Row(y + 1) + x0, count, signal.Row(y) + x0);
  }
}

}  // namespace

void LowPass(float sigma, const Plane& from, Plane* to) {
  const float weight = Exp(-kSqrt2 / sigma);
  const int width = to->width();
  const int height = to->height();
  if (width == 0) return;
  const std::vector<float> weights(static_cast<size_t>(std::max(width, kColumnsPerTask)), weight);
  const std::vector<const float*> row_weights(static_cast<size_t>(height), weights.data());
  std::vector<const float*> sources;
  std::vector<float*> rows;
  for (int y = 0; y < height; ++y) {
    sources.push_back(from.Row(y));
    rows.push_back(to->Row(y));
  }
  RecurseRows(sources.data(), row_weights.data(), rows.size(), width, rows.data());
  for (int x0 = 0; x0 < width; x0 += kColumnsPerTask) {  // side by side as many as stay in the cache
    const int count = std::min(kColumnsPerTask, width - x0);
    for (int y = 1; y < height; ++y) PullRow(weights.data(), to->Row(y - 1) + x0, count, to->Row(y) + x0);
    for (int y = height - 2; y >= 0; --y)
      PullRow(weights.data(), to->Row(y + 1) + x0, count, to->Row(y) + x0);
  }
}

void GuidedLowPass(float sigma, float range, const Planes& guide, TaskPool* pool, Planes* signals) {
  const int width = guide[0].width();
  const int height = guide[0].height();
  ParallelFor(pool, (height + kRowsPerTask - 1) / kRowsPerTask, [&](int64_t task) {
    const int y0 = static_cast<int>(task) * kRowsPerTask;
    GuidedRows(sigma, range, guide, y0, std::min(y0 + kRowsPerTask, height), signals);
  });
  ParallelFor(pool, (width + kColumnsPerTask - 1) / kColumnsPerTask, [&](int64_t task) {
    const int x0 = static_cast<int>(task) * kColumnsPerTask;
    GuidedColumns(sigma, range, guide, x0, std::min(x0 + kColumnsPerTask, width), signals);
  });
}

}  // namespace lumifold::filter
