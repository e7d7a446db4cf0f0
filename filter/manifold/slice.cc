#include "filter/manifold/slice.h"

#include <algorithm>

#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr size_t kPsiStride = kStripColumns + 2 + kCellPadding;
/// Pixels with points that a task works on.
constexpr size_t kPixelsPerTask = 256;

/// The points of one pixel.
class PointSlicer {
 public:
  PointSlicer(const PixelState& state, const SlicePoints& points)
      : state_(state), points_(points), squares_(points.samples) {}

  void Slice(size_t pixel, const Manifold& manifold, const Planes& psi, SlicedPoints* sums) {
    const auto [x, y] = points_.pixels[pixel];
    const CellReader reader(state_.lattice, x, y);
    if (!Measure(pixel, manifold, reader)) return;
    const size_t samples = points_.samples;
    float* weights = sums->weights.data() + pixel * samples;
    const float found = reader.Read(psi.back());
    for (size_t j = 0; j < samples; ++j) weights[j] += squares_[j] * found;
    float* values = sums->values.data() + pixel * (psi.size() - 1) * samples;
    for (size_t c = 0; c + 1 < psi.size(); ++c, values += samples) {
      const float value = reader.Read(psi[c]);
      for (size_t j = 0; j < samples; ++j) values[j] += squares_[j] * value;
    }
  }

 private:
  /// The points' weights on the manifold, into squares_; false where all are 0.
  bool Measure(size_t pixel, const Manifold& manifold, const CellReader& reader) {
    const auto [x, y] = points_.pixels[pixel];
    const size_t shared = manifold.eta.size() - points_.own_features;
    float square = 0;
    for (size_t k = 0; k < shared; ++k) {
      const float offset = state_.features[k].At(x, y) - reader.Read(manifold.eta[k]);
      square += offset * offset;
    }
    if (square / points_.pixel_divisor >= kFarthest) return false;
    std::fill(squares_.begin(), squares_.end(), square / points_.pixel_divisor);
    const float* own = points_.features.data() + pixel * points_.own_features * points_.samples;
    for (size_t k = 0; k < points_.own_features; ++k, own += points_.samples) {
      const float eta = reader.Read(manifold.eta[shared + k]);
      for (size_t j = 0; j < points_.samples; ++j) squares_[j] += (own[j] - eta) * (own[j] - eta);
    }
    if (*std::min_element(squares_.begin(), squares_.end()) >= kFarthest) return false;
    for (float& s : squares_) s = s < kFarthest ? Exp(-s) : 0.0f;
    return true;
  }

  const PixelState& state_;
  const SlicePoints& points_;
  std::vector<float> squares_;
};

}  // namespace

StripSlice::StripSlice(const PixelState& state, const std::vector<Planes>& psi)
    : state_(state),
      psi_(psi),
      planes_(psi[0].size()),
      cells_(psi.size() * planes_ * kPsiStride),
      upper_(psi.size() * planes_),
      lower_(upper_.size()),
      weight_rows_(psi.size()),
      sum_rows_(planes_) {}

void StripSlice::PixelRow(int y, Planes* sums) {
  const Lattice& lattice = state_.lattice;
  const CellSpan span = SpanOf(y, lattice.step, lattice.Rows());
  for (size_t i = 0; i < upper_.size(); ++i) {
    const Plane& cells = psi_[i / planes_][i % planes_];
    upper_[i] = cells.Row(span.first);
    lower_[i] = cells.Row(span.second);
  }
  for (int x0 = 0; x0 < lattice.width; x0 += kStripColumns) {
    const int count = std::min(kStripColumns, lattice.width - x0);
    BlendCells({upper_.data(), lower_.data(), span.part, upper_.size(), x0 / lattice.step - 1,
                count / lattice.step + 3, lattice.Columns(), cells_.data(), kPsiStride});
    for (size_t i = 0; i < weight_rows_.size(); ++i) weight_rows_[i] = state_.weights[i].Row(y) + x0;
    for (size_t c = 0; c < planes_; ++c) sum_rows_[c] = (*sums)[c].Row(y) + x0;
    SliceRow(state_.widening, {weight_rows_.data(), weight_rows_.size(), cells_.data(), kPsiStride, planes_,
                               sum_rows_.data(), count});
  }
}

void SlicePointsAt(const PixelState& state, const std::vector<Manifold>& manifolds,
                   const std::vector<Planes>& psi, const SlicePoints& points, TaskPool* pool,
                   SlicedPoints* sums) {
  const size_t tasks = (points.pixels.size() + kPixelsPerTask - 1) / kPixelsPerTask;
  ParallelFor(pool, static_cast<int64_t>(tasks), [&](int64_t task) {
    PointSlicer slicer(state, points);
    const size_t first = static_cast<size_t>(task) * kPixelsPerTask;
    const size_t last = std::min(first + kPixelsPerTask, points.pixels.size());
    for (size_t pixel = first; pixel < last; ++pixel) {
      for (size_t i = 0; i < manifolds.size(); ++i) slicer.Slice(pixel, manifolds[i], psi[i], sums);
    }
  });
}

}  // namespace lumifold::filter
