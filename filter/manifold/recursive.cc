#include "filter/manifold/recursive.h"

#include <algorithm>
#include <utility>

#include "filter/image/portable_math.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/manifold/recursion_kernels.h"

namespace lumifold::filter {
namespace {

constexpr int kRowsPerTask = 16;
constexpr int kColumnsPerTask = 128;

/// A blur along a guide, to several reaches.
class GuidedBlur {
 public:
  GuidedBlur(absl::Span<const float> sigmas, float range, const Planes& guide, const Planes& signals)
      : guide_(guide), signals_(signals) {
    for (const float sigma : sigmas) {
      reaches_.push_back({sigma, (sigma / range) * (sigma / range)});
      blurred_.push_back(MakeUninitializedPlanes(signals.size(), guide[0].width(), guide[0].height()));
      down_.push_back(Plane::Uninitialized(guide[0].width(), guide[0].height()));
    }
  }

  /// Rows [y0, y1), all of them together, and their links to the rows above, for the guide is read but once.
  void Rows(int y0, int y1);
  /// Then columns [x0, x1), side by side.
  void Columns(int x0, int x1);
  std::vector<Planes> Take() { return std::move(blurred_); }

 private:
  /// The links of `count` cells from (x, y) on with those (dx, dy) from them, of each reach into row
  /// `row` of its plane.
  void Link(int x, int y, int dx, int dy, int row, Planes* links) const;

  const Planes& guide_;
  const Planes& signals_;
  std::vector<LinkReach> reaches_;
  std::vector<Planes> blurred_;  // of each reach
  Planes down_;                  // of each reach: links of each cell with the one above
};

void GuidedBlur::Link(int x, int y, int dx, int dy, int row, Planes* links) const {
  std::vector<const float*> here, there;
  for (const Plane& plane : guide_) {
    here.push_back(plane.Row(y) + x);
    there.push_back(plane.Row(y + dy) + x + dx);
  }
  std::vector<float*> weights;
  for (Plane& plane : *links) weights.push_back(plane.Row(row) + x);
  LinkRow({here.data(), there.data(), guide_.size(), guide_[0].width() - x}, reaches_.data(), reaches_.size(),
          weights.data());
}

void GuidedBlur::Rows(int y0, int y1) {
  const int width = guide_[0].width();
  Planes across = MakeUninitializedPlanes(reaches_.size(), width, y1 - y0);
  for (int y = y0; y < y1; ++y) {
    Link(1, y, -1, 0, y - y0, &across);
    if (y > 0) Link(0, y, 0, -1, y, &down_);
  }
  for (size_t r = 0; r < reaches_.size(); ++r) {
    std::vector<const float*> from, weights;
    std::vector<float*> to;
    for (size_t c = 0; c < signals_.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        from.push_back(signals_[c].Row(y));
        to.push_back(blurred_[r][c].Row(y));
      }
    }
    for (int y = y0; y < y1; ++y) weights.push_back(across[r].Row(y - y0));
    RecurseRows({from.data(), to.data(), signals_.size(), weights.size(), width}, weights.data());
  }
}

void GuidedBlur::Columns(int x0, int x1) {
  const int height = guide_[0].height();
  for (size_t r = 0; r < reaches_.size(); ++r) {
    for (Plane& plane : blurred_[r]) {
      for (int y = 1; y < height; ++y)
        PullRow(down_[r].Row(y) + x0, plane.Row(y - 1) + x0, x1 - x0, plane.Row(y) + x0);
      for (int y = height - 2; y >= 0; --y)
        PullRow(down_[r].Row(y + 1) + x0, plane.Row(y + 1) + x0, x1 - x0, plane.Row(y) + x0);
    }
  }
}

}  // namespace

void LowPass(float sigma, Plane* plane) {
  const float weight = Exp(-kSqrt2 / sigma);
  const int width = plane->width();
  const int height = plane->height();
  if (width == 0) return;
  std::vector<float*> rows;
  for (int y = 0; y < height; ++y) rows.push_back(plane->Row(y));
  RecurseRowsEvenly({rows.data(), rows.data(), 1, rows.size(), width}, weight);
  for (int x0 = 0; x0 < width; x0 += kColumnsPerTask) {  // side by side as many as stay in the cache
    const int count = std::min(kColumnsPerTask, width - x0);
    for (int y = 1; y < height; ++y) PullRowEvenly(weight, plane->Row(y - 1) + x0, count, plane->Row(y) + x0);
    for (int y = height - 2; y >= 0; --y)
      PullRowEvenly(weight, plane->Row(y + 1) + x0, count, plane->Row(y) + x0);
  }
}

std::vector<Planes> GuidedLowPass(absl::Span<const float> sigmas, float range, const Planes& guide,
                                  const Planes& signals, TaskPool* pool) {
  const int width = guide[0].width();
  const int height = guide[0].height();
  GuidedBlur blur(sigmas, range, guide, signals);
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
