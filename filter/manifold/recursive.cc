#include "filter/manifold/recursive.h"

#include <algorithm>
#include <utility>

#include "filter/image/portable_math.h"
#include "filter/kernels/recursion_kernels.h"
#include "filter/manifold/manifold_constants.h"

namespace lumifold::filter {
namespace {

constexpr int kRowsPerTask = 16;
constexpr int kColumnsPerTask = 128;

/// A blur along a guide.
class GuidedBlur {
 public:
  GuidedBlur(float sigma, float range, const Planes& guide, const Planes& signals)
      : reach_{sigma, (sigma / range) * (sigma / range)},
        guide_(guide),
        signals_(signals),
        blurred_(MakeUninitializedPlanes(signals.size(), guide[0].width(), guide[0].height())),
        down_(Plane::Uninitialized(guide[0].width(), guide[0].height())) {}

  /// Rows [y0, y1), all of them together, and their links to the rows above.
  void Rows(int y0, int y1);
  /// Then columns [x0, x1), side by side.
  void Columns(int x0, int x1);
  Planes Take() { return std::move(blurred_); }

 private:
  /// The links of the cells from (x, y) to the row's end with those (dx, dy) from them.
  void Link(int x, int y, int dx, int dy, float* links) const;

  const LinkReach reach_;
  const Planes& guide_;
  const Planes& signals_;
  Planes blurred_;
  Plane down_;  // links of each cell with the one above
};

void GuidedBlur::Link(int x, int y, int dx, int dy, float* links) const {
  std::vector<const float*> here, there;
  for (const Plane& plane : guide_) {
    here.push_back(plane.Row(y) + x);
    there.push_back(plane.Row(y + dy) + x + dx);
  }
  LinkRow({here.data(), there.data(), guide_.size(), guide_[0].width() - x}, reach_, links);
}

void GuidedBlur::Rows(int y0, int y1) {
  const int width = guide_[0].width();
  Plane across = Plane::Uninitialized(width, y1 - y0);
  std::vector<const float*> from, weights;
  std::vector<float*> to;
  for (int y = y0; y < y1; ++y) {
    Link(1, y, -1, 0, across.Row(y - y0) + 1);
    if (y > 0) Link(0, y, 0, -1, down_.Row(y));
    weights.push_back(across.Row(y - y0));
  }
  for (size_t c = 0; c < signals_.size(); ++c) {
    for (int y = y0; y < y1; ++y) {
      from.push_back(signals_[c].Row(y));
      to.push_back(blurred_[c].Row(y));
    }
  }
  RecurseRows({from.data(), to.data(), signals_.size(), weights.size(), width}, weights.data());
}

void GuidedBlur::Columns(int x0, int x1) {
  const int height = guide_[0].height();
  for (Plane& plane : blurred_) {
    for (int y = 1; y < height; ++y)
      PullRow(down_.Row(y) + x0, plane.Row(y - 1) + x0, x1 - x0, plane.Row(y) + x0);
    for (int y = height - 2; y >= 0; --y)
      PullRow(down_.Row(y + 1) + x0, plane.Row(y + 1) + x0, x1 - x0, plane.Row(y) + x0);
  }
}

}  // namespace

void LowPass(float sigma, Plane* plane) {
  const float weight = Exp(-kSqrt2 / sigma);
  const int width = plane->width();
  const int height = plane->height();
  if (width == 0) return;
  std::vector<float*> rows;
  rows.reserve(static_cast<size_t>(height));
  for (int y = 0; y < height; ++y) rows.push_back(plane->Row(y));
  RecurseRowsEvenly({rows.data(), rows.data(), 1, rows.size(), width}, weight);
  for (int x0 = 0; x0 < width; x0 += kColumnsPerTask) {  // side by side as many as stay in the cache
    const int count = std::min(kColumnsPerTask, width - x0);
    for (int y = 1; y < height; ++y) PullRowEvenly(weight, plane->Row(y - 1) + x0, count, plane->Row(y) + x0);
    for (int y = height - 2; y >= 0; --y)
      PullRowEvenly(weight, plane->Row(y + 1) + x0, count, plane->Row(y) + x0);
  }
}

Planes GuidedLowPass(float sigma, float range, const Planes& guide, const Planes& signals, TaskPool* pool) {
  const int width = guide[0].width();
  const int height = guide[0].height();
  GuidedBlur blur(sigma, range, guide, signals);
  ParallelFor(pool, (height + kRowsPerTask - 1) / kRowsPerTask, [&](int64_t task) {
    const int y0 = static_cast<int>(task) * kRowsPerTask;
    blur.Rows(y0, std::min(y0 + kRowsPerTask, height));
  });
  ParallelFor(pool, (width + kColumnsPerTask - 1) / kColumnsPerTask, [&](int64_t task) {
    const int x0 = static_cast<int>(task) * kColumnsPerTask;
    blur.Columns(x0, std::min(x0 + kColumnsPerTask, width));
  });
  return blur.Take();
}

}  // namespace lumifold::filter
