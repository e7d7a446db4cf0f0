#include "filter/manifold/points.h"

#include <algorithm>

#include "absl/functional/function_ref.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

/// Entries of SlicePoints::pixels that a task works on.
constexpr size_t kPixelsPerTask = 256;

bool IsSamePixelAsLast(const SlicePoints& points, size_t i) {
  return i > 0 && points.pixels[i] == points.pixels[i - 1];
}

/// Calls body(first, last) for each run of entries of one pixel: what is read from cells is the same for all of them.
void ForEachRun(const SlicePoints& points, TaskPool* pool, absl::FunctionRef<void(size_t, size_t)> body) {
  const size_t count = points.pixels.size();
  ParallelFor(pool, static_cast<int64_t>((count + kPixelsPerTask - 1) / kPixelsPerTask), [&](int64_t task) {
    size_t first = static_cast<size_t>(task) * kPixelsPerTask;
    const size_t end = std::min(first + kPixelsPerTask, count);
    while (first < end && IsSamePixelAsLast(points, first)) ++first;  // the task before has it
    while (first < end) {
      size_t last = first + 1;
      while (last < count && IsSamePixelAsLast(points, last)) ++last;
      body(first, last);
      first = last;
    }
  });
}

/// Writes the weights on a manifold of the points of entries [first, last), which are of the pixel that `reader` reads.
void WeighRun(const CellReader& reader, const PixelState& state, const SlicePoints& points, size_t first,
              size_t last, const Planes& eta, float* weights) {
  const auto [x, y] = points.pixels[first];
  const size_t samples = points.samples;
  const size_t shared = eta.size() - points.own_features;
  float square = 0;
  for (size_t k = 0; k < shared; ++k) {
    const float offset = state.features[k].At(x, y) - reader.Read(eta[k]);
    square += offset * offset;
  }
  square /= points.pixel_divisor;
  float* const begin = weights + first * samples;
  float* const end = weights + last * samples;
  std::fill(begin, end, square);
  // Sums of squares only grow: once all points are too far to have a weight, what is left of them is not added.
  const auto are_far = [&] { return std::all_of(begin, end, [](float w) { return w >= kFarthest; }); };
  for (size_t k = 0; k < points.own_features && !are_far(); ++k) {
    const float height = reader.Read(eta[shared + k]);
    for (size_t i = first; i < last; ++i) {
      const float* own = points.features.data() + (i * points.own_features + k) * samples;
      for (size_t j = 0; j < samples; ++j)
        weights[i * samples + j] += (own[j] - height) * (own[j] - height);
    }
  }
  for (float* w = begin; w < end; ++w) *w = *w < kFarthest ? Exp(-*w) : 0.0f;
}

}  // namespace

PointWeights WeighPoints(const PixelState& state, const std::vector<Manifold>& manifolds,
                         const SlicePoints& points, TaskPool* pool) {
  PointWeights weights(manifolds.size(), std::vector<float>(points.pixels.size() * points.samples));
  ForEachRun(points, pool, [&](size_t first, size_t last) {
    const CellReader reader(state.lattice, points.pixels[first][0], points.pixels[first][1]);
    for (size_t i = 0; i < manifolds.size(); ++i)
      WeighRun(reader, state, points, first, last, manifolds[i].eta, weights[i].data());
  });
  return weights;
}

void SplatPoints(const PixelState& state, const SlicePoints& points, const std::vector<float>& signals,
                 const PointWeights& weights, TaskPool* pool, std::vector<Planes>* splats) {
  const Lattice& lattice = state.lattice;
  const size_t samples = points.samples;
  ParallelFor(pool, static_cast<int64_t>(splats->size()), [&](int64_t task) {
    Planes& cells = (*splats)[static_cast<size_t>(task)];
    const std::vector<float>& on_manifold = weights[static_cast<size_t>(task)];
    const size_t channels = cells.size() - 1;
    for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
      const int column = points.pixels[pixel][0] / lattice.step;
      const int row = points.pixels[pixel][1] / lattice.step;
      const auto area = static_cast<float>(lattice.ColumnWidth(column) * lattice.RowHeight(row));
      for (size_t j = 0; j < samples; ++j) {
        const float weight = points.weights[pixel * samples + j] * on_manifold[pixel * samples + j] / area;
        if (weight == 0) continue;
        for (size_t c = 0; c < channels; ++c)
          cells[c].At(column, row) += weight * signals[(pixel * channels + c) * samples + j];
        cells[channels].At(column, row) += weight;
      }
    }
  });
}

void SlicePointsAt(const PixelState& state, const std::vector<Planes>& psi, const SlicePoints& points,
                   const PointWeights& weights, TaskPool* pool, SlicedPoints* sums) {
  const size_t samples = points.samples;
  const size_t channels = psi[0].size() - 1;
  ForEachRun(points, pool, [&](size_t first, size_t last) {
    const CellReader reader(state.lattice, points.pixels[first][0], points.pixels[first][1]);
    for (size_t i = 0; i < psi.size(); ++i) {
      const float* on_manifold = weights[i].data();
      if (std::all_of(on_manifold + first * samples, on_manifold + last * samples,
                      [](float w) { return w == 0; }))
        continue;
      for (size_t c = 0; c <= channels; ++c) {
        const float value = reader.Read(psi[i][c]);
        for (size_t e = first; e < last; ++e) {
          float* to = c < channels ? sums->values.data() + (e * channels + c) * samples
                                   : sums->weights.data() + e * samples;
          for (size_t j = 0; j < samples; ++j) to[j] += on_manifold[e * samples + j] * value;
        }
      }
    }
  });
}

}  // namespace lumifold::filter
