#include "filter/manifold/recursive.h"

#include <algorithm>
#include <utility>

#include "filter/image/portable_math.h"
#include "filter/kernels/recursion_kernels.h"
#include "filter/manifold/manifold_constants.h"

namespace lumifold::filter {
namespace {

/// Rows blurred before they are pulled down: they stay in the cache meanwhile.
constexpr int kRowsTogether = 32;
/// Signals of one task: as many as rows are recursed side by side.
constexpr size_t kSignalsPerTask = 4;

/// A blur along a guide.
class GuidedBlur {
 public:
  GuidedBlur(float sigma, float range, const Planes& guide, const Planes& signals)
      : reach_{sigma, (sigma / range) * (sigma / range)},
        guide_(guide),
        signals_(signals),
        blurred_(MakeUninitializedPlanes(signals.size(), guide[0].width(), guide[0].height())),
        across_(Plane::Uninitialized(guide[0].width(), guide[0].height())),
        down_(Plane::Uninitialized(guide[0].width(), guide[0].height())) {}

  /// The links of rows [y0, y1) of cells along them and with the rows above.
  void Link(int y0, int y1);
  /// Then signals [first, last).
  void Blur(size_t first, size_t last);
  Planes Take() { return std::move(blurred_); }

 private:
  /// The links of the cells from (x, y) to the row's end with those (dx, dy) from them.
  void Link(int x, int y, int dx, int dy, float* links) const;
  void BlurRows(size_t first, size_t last, int y0, int y1);

  const LinkReach reach_;
  const Planes& guide_;
  const Planes& signals_;
  Planes blurred_;
  Plane across_;  // links of each cell with the one to the left
  Plane down_;    // with the one above
};

void GuidedBlur::Link(int x, int y, int dx, int dy, float* links) const {
  std::vector<const float*> here, there;
  for (const Plane& plane : guide_) {
    here.push_back(plane.Row(y) + x);
    there.push_back(plane.Row(y + dy) + x + dx);
  }
  LinkRow({here.data(), there.data(), guide_.size(), guide_[0].width() - x}, reach_, links);
}

void GuidedBlur::Link(int y0, int y1) {
  for (int y = y0; y < y1; ++y) {
    Link(1, y, -1, 0, across_.Row(y) + 1);
    if (y > 0) Link(0, y, 0, -1, down_.Row(y));
  }
}

void GuidedBlur::BlurRows(size_t first, size_t last, int y0, int y1) {
  std::vector<const float*> from, weights;
  std::vector<float*> to;
  for (int y = y0; y < y1; ++y) weights.push_back(across_.Row(y));
  for (size_t c = first; c < last; ++c) {
    for (int y = y0; y < y1; ++y) {
      from.push_back(signals_[c].Row(y));
      to.push_back(blurred_[c].Row(y));
    }
  }
  RecurseRows({from.data(), to.data(), last - first, weights.size(), across_.width()}, weights.data());
}

void GuidedBlur::Blur(size_t first, size_t last) {
  const int width = across_.width();
  const int height = across_.height();
  for (int y0 = 0; y0 < height; y0 += kRowsTogether) {
    const int y1 = std::min(y0 + kRowsTogether, height);
    BlurRows(first, last, y0, y1);
    for (size_t c = first; c < last; ++c) {
      for (int y = std::max(y0, 1); y < y1; ++y)
        PullRow(down_.Row(y), blurred_[c].Row(y - 1), width, blurred_[c].Row(y));
    }
  }
  for (int y = height - 2; y >= 0; --y) {
    for (size_t c = first; c < last; ++c)
      PullRow(down_.Row(y + 1), blurred_[c].Row(y + 1), width, blurred_[c].Row(y));
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
  for (int y0 = 0; y0 < height; y0 += kRowsTogether) {
    const int y1 = std::min(y0 + kRowsTogether, height);
    float* const* block = rows.data() + y0;
    RecurseRowsEvenly({block, block, 1, static_cast<size_t>(y1 - y0), width}, weight);
    for (int y = std::max(y0, 1); y < y1; ++y) PullRowEvenly(weight, plane->Row(y - 1), width, plane->Row(y));
  }
  for (int y = height - 2; y >= 0; --y) PullRowEvenly(weight, plane->Row(y + 1), width, plane->Row(y));
}

Planes GuidedLowPass(float sigma, float range, const Planes& guide, const Planes& signals, TaskPool* pool) {
  const int height = guide[0].height();
  GuidedBlur blur(sigma, range, guide, signals);
  ParallelFor(pool, (height + kRowsTogether - 1) / kRowsTogether, [&](int64_t task) {
    const int y0 = static_cast<int>(task) * kRowsTogether;
    blur.Link(y0, std::min(y0 + kRowsTogether, height));
  });
  ParallelFor(pool, static_cast<int64_t>((signals.size() + kSignalsPerTask - 1) / kSignalsPerTask),
              [&](int64_t task) {
                const size_t first = static_cast<size_t>(task) * kSignalsPerTask;
                blur.Blur(first, std::min(first + kSignalsPerTask, signals.size()));
              });
  return blur.Take();
}

}  // namespace lumifold::filter
