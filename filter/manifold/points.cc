#include "filter/manifold/points.h"

#include <algorithm>
#include <utility>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/kernel_constants.h"

namespace lumifold::filter {
namespace {

constexpr int64_t kRunsPerTask = 128;
/// Cells packed at a time: all planes of so many stay in the cache.
constexpr int64_t kCellsPerTask = 64;
/// Floats to which packed cells and weights are padded: loops over them need no remainder.
constexpr size_t kLanes = 4;

constexpr size_t kMostManifolds = 128;  // of a level

size_t Padded(size_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

/// Numbers for cells in the order in which they are first asked for.
class CellNumbers {
 public:
  explicit CellNumbers(const Lattice& lattice)
      : columns_(lattice.Columns()),
        numbers_(static_cast<size_t>(lattice.Columns()) * static_cast<size_t>(lattice.Rows()), kNone) {}

  uint32_t Of(int column, int row) {
    uint32_t& number = numbers_[static_cast<size_t>(row * columns_ + column)];
    if (number == kNone) {
      number = static_cast<uint32_t>(cells_.size());
      cells_.push_back({column, row});
    }
    return number;
  }
  std::vector<std::array<int, 2>> TakeCells() { return std::move(cells_); }

 private:
  static constexpr uint32_t kNone = ~uint32_t{0};

  int columns_;
  std::vector<uint32_t> numbers_;
  std::vector<std::array<int, 2>> cells_;
};

/// Calls body(run, scratch) for each run; `scratch` has so many floats.
void ForEachRun(size_t runs, size_t scratch, TaskPool* pool, absl::FunctionRef<void(size_t, float*)> body) {
  const auto count = static_cast<int64_t>(runs);
  ParallelFor(pool, (count + kRunsPerTask - 1) / kRunsPerTask, [&](int64_t task) {
    std::vector<float> memory(scratch);
    for (int64_t run = task * kRunsPerTask; run < std::min((task + 1) * kRunsPerTask, count); ++run)
      body(static_cast<size_t>(run), memory.data());
  });
}

/// squares[i] += (feature - heights[i])^2 for whole groups of lanes.
void AddSquares(float feature, const float* __restrict heights, size_t lanes, float* __restrict squares) {
  for (size_t first = 0; first < lanes; first += kLanes) {
    for (size_t i = first; i < first + kLanes; ++i)
      squares[i] += (feature - heights[i]) * (feature - heights[i]);
  }
}

}  // namespace

Points::Points(const SlicePoints& points, const Planes& features, const Lattice& lattice)
    : points_(points),
      shared_features_(features.size() - points.own_features),
      by_row_(static_cast<size_t>(lattice.Rows())) {
  CellNumbers numbers(lattice);
  const size_t count = points.pixels.size();
  for (size_t first = 0; first < count;) {
    size_t last = first + 1;
    while (last < count && points.pixels[last] == points.pixels[first]) ++last;
    const auto [x, y] = points.pixels[first];
    const CellSpan column = SpanOf(x, lattice.step, lattice.Columns());
    const CellSpan row = SpanOf(y, lattice.step, lattice.Rows());
    const int own_column = x / lattice.step;
    const int own_row = y / lattice.step;
    runs_.push_back(
        {.first = first,
         .last = last,
         .corners = {numbers.Of(column.first, row.first), numbers.Of(column.second, row.first),
                     numbers.Of(column.first, row.second), numbers.Of(column.second, row.second)},
         .column_part = column.part,
         .row_part = row.part,
         .own = numbers.Of(own_column, own_row),
         .area = static_cast<float>(lattice.ColumnWidth(own_column) * lattice.RowHeight(own_row))});
    for (size_t k = 0; k < shared_features_; ++k) pixel_features_.push_back(features[k].At(x, y));
    by_row_[static_cast<size_t>(own_row)].push_back(runs_.size() - 1);
    first = last;
  }
  cells_ = numbers.TakeCells();
}

void Points::ForEachCells(TaskPool* pool, absl::FunctionRef<void(size_t, size_t)> body) const {
  const auto count = static_cast<int64_t>(cells_.size());
  ParallelFor(pool, (count + kCellsPerTask - 1) / kCellsPerTask, [&](int64_t task) {
    const int64_t first = task * kCellsPerTask;
    body(static_cast<size_t>(first), static_cast<size_t>(std::min(first + kCellsPerTask, count)));
  });
}

Points::Packed Points::Pack(size_t sets, absl::FunctionRef<const Planes&(size_t)> planes_of, size_t pitch,
                            TaskPool* pool) const {
  const size_t planes = planes_of(0).size();
  Packed packed{Padded(planes * pitch), {}};
  packed.cells.resize(cells_.size() * packed.stride);
  ForEachCells(pool, [&](size_t first, size_t last) {
    for (size_t set = 0; set < sets; ++set) {
      for (size_t k = 0; k < planes; ++k) {
        const Plane& plane = planes_of(set)[k];
        float* to = packed.cells.data() + k * pitch + set;
        for (size_t i = first; i < last; ++i) to[i * packed.stride] = plane.At(cells_[i][0], cells_[i][1]);
      }
    }
  });
  return packed;
}

void Points::Read(const Packed& packed, const Run& run, float* __restrict values) {
  const auto at = [&](size_t corner) { return packed.cells.data() + run.corners[corner] * packed.stride; };
  const float* __restrict upper_left = at(0);
  const float* __restrict upper_right = at(1);
  const float* __restrict lower_left = at(2);
  const float* __restrict lower_right = at(3);
  for (size_t first = 0; first < packed.stride; first += kLanes) {
    for (size_t k = first; k < first + kLanes; ++k) {
      const float left = upper_left[k] + run.row_part * (lower_left[k] - upper_left[k]);
      const float right = upper_right[k] + run.row_part * (lower_right[k] - upper_right[k]);
      values[k] = left + run.column_part * (right - left);
    }
  }
}

void Points::WeighRun(size_t run, const Packed& eta, size_t lanes, float* scratch, float* weights) const {
  float* const heights = scratch;
  float* const squares = scratch + eta.stride;
  Read(eta, runs_[run], heights);
  std::fill_n(squares, lanes, 0.0f);
  for (size_t k = 0; k < shared_features_; ++k)
    AddSquares(pixel_features_[run * shared_features_ + k], heights + k * lanes, lanes, squares);
  for (size_t i = 0; i < lanes; ++i) squares[i] /= points_.pixel_divisor;
  const size_t samples = points_.samples;
  for (size_t p = runs_[run].first * samples; p < runs_[run].last * samples; ++p) {
    float* const to = weights + p * lanes;
    std::copy_n(squares, lanes, to);
    const float* own = points_.features.data() + p / samples * points_.own_features * samples + p % samples;
    for (size_t k = 0; k < points_.own_features; ++k)
      AddSquares(own[k * samples], heights + (shared_features_ + k) * lanes, lanes, to);
    for (size_t group = 0; group < lanes; group += kLanes) {
      for (size_t i = group; i < group + kLanes; ++i) to[i] = to[i] < kFarthest ? Exp(-to[i]) : 0.0f;
    }
  }
}

PointWeights Points::Weigh(const std::vector<Manifold>& manifolds, TaskPool* pool) const {
  const size_t lanes = Padded(manifolds.size());
  const Packed eta =
      Pack(manifolds.size(), [&](size_t i) -> const Planes& { return manifolds[i].eta; }, lanes, pool);
  PointWeights weights{lanes, std::vector<float>(points_.pixels.size() * points_.samples * lanes)};
  ForEachRun(runs_.size(), eta.stride + lanes, pool,
             [&](size_t run, float* scratch) { WeighRun(run, eta, lanes, scratch, weights.values.data()); });
  return weights;
}

void Points::SplatRun(const Run& run, const std::vector<float>& signals, const std::vector<float>& masses,
                      const PointWeights& weights, Packed* splats) const {
  const size_t samples = points_.samples;
  const size_t lanes = weights.stride;
  const size_t channels = splats->stride / lanes - 1;
  float* __restrict cell = splats->cells.data() + run.own * splats->stride;
  for (size_t p = run.first * samples; p < run.last * samples; ++p) {
    if (masses[p] == 0) continue;
    const float* __restrict on_manifolds = weights.values.data() + p * lanes;
    const float* signal = signals.data() + p / samples * channels * samples + p % samples;
    std::array<float, kMostManifolds> mass;
    for (size_t i = 0; i < lanes; ++i) mass[i] = masses[p] * on_manifolds[i] / run.area;
    for (size_t c = 0; c <= channels; ++c) {
      const float value = c < channels ? signal[c * samples] : 1.0f;
      for (size_t i = 0; i < lanes; ++i) cell[c * lanes + i] += mass[i] * value;
    }
  }
}

void Points::Splat(const std::vector<float>& signals, const std::vector<float>& masses,
                   const PointWeights& weights, TaskPool* pool, std::vector<Planes>* splats) const {
  Packed packed =
      Pack(splats->size(), [&](size_t i) -> const Planes& { return (*splats)[i]; }, weights.stride, pool);
  ParallelFor(pool, static_cast<int64_t>(by_row_.size()), [&](int64_t row) {
    for (const size_t run : by_row_[static_cast<size_t>(row)])
      SplatRun(runs_[run], signals, masses, weights, &packed);
  });
  ForEachCells(pool, [&](size_t first, size_t last) {
    for (size_t manifold = 0; manifold < splats->size(); ++manifold) {
      for (size_t k = 0; k < (*splats)[manifold].size(); ++k) {
        const float* from = packed.cells.data() + k * weights.stride + manifold;
        for (size_t i = first; i < last; ++i)
          (*splats)[manifold][k].At(cells_[i][0], cells_[i][1]) = from[i * packed.stride];
      }
    }
  });
}

void Points::SliceRun(const Run& run, const Packed& psi, size_t manifold, size_t channels,
                      const PointWeights& weights, float* scratch, SlicedPoints* sums) const {
  const size_t samples = points_.samples;
  const auto weight_of = [&](size_t p) { return weights.values[p * weights.stride + manifold]; };
  size_t p = run.first * samples;
  while (p < run.last * samples && weight_of(p) == 0) ++p;
  if (p == run.last * samples) return;
  Read(psi, run, scratch);
  for (; p < run.last * samples; ++p) {
    const float weight = weight_of(p);
    float* to = sums->values.data() + p / samples * channels * samples + p % samples;
    if (samples == 1) {
      for (size_t c = 0; c < channels; ++c) to[c] += weight * scratch[c];
    } else {
      for (size_t c = 0; c < channels; ++c) to[c * samples] += weight * scratch[c];
    }
    sums->weights[p] += weight * scratch[channels];
  }
}

void Points::Slice(const std::vector<Planes>& psi, const PointWeights& weights, TaskPool* pool,
                   SlicedPoints* sums) const {
  const size_t channels = psi[0].size() - 1;
  std::vector<Packed> packed;
  for (const Planes& planes : psi)
    packed.push_back(Pack(1, [&](size_t) -> const Planes& { return planes; }, 1, pool));
  ForEachRun(runs_.size(), packed[0].stride, pool, [&](size_t run, float* scratch) {
    for (size_t i = 0; i < packed.size(); ++i)
      SliceRun(runs_[run], packed[i], i, channels, weights, scratch, sums);
  });
}

}  // namespace lumifold::filter
