#include "filter/manifold/sites.h"

#include <algorithm>
#include <array>

namespace lumifold::filter {

Sites::Sites(const Lattice& lattice, const SlicePoints* points)
    : lattice_(lattice),
      strips_(static_cast<size_t>((lattice.Columns() + lattice.StripCells() - 1) / lattice.StripCells())) {
  std::vector<std::vector<size_t>> by_strip(static_cast<size_t>(lattice.height) * strips_);
  absl::Span<const std::array<int, 2>> pixels;
  if (points != nullptr) pixels = points->pixels;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto [x, y] = pixels[i];
    by_strip[StripOf(y, x / lattice.step)].push_back(i);
  }
  places_.resize(pixels.size());
  for (const std::vector<size_t>& of_strip : by_strip) {
    first_runs_.push_back(runs_.size());
    if (!of_strip.empty()) Append(of_strip, pixels);
  }
  first_runs_.push_back(runs_.size());
}

void Sites::Append(absl::Span<const size_t> points, absl::Span<const std::array<int, 2>> pixels) {
  const Phases phases(lattice_.step);
  const bool is_first = runs_.empty();
  int row = is_first ? lattice_.height : runs_.back().row;
  int x = is_first ? 0 : (runs_.back().x + runs_.back().count + kRowPadding - 1) / kRowPadding * kRowPadding;
  const size_t first_run = runs_.size();
  for (const size_t i : points) {
    if (x == Width()) {
      ++row;
      x = 0;
    }
    if (runs_.size() == first_run || runs_.back().row != row) runs_.push_back({row, x, 0});
    ++runs_.back().count;
    point_rows_ = row - lattice_.height + 1;
    const size_t size = static_cast<size_t>(point_rows_) * static_cast<size_t>(Width());
    left_.resize(size, 0);
    own_.resize(size, 0);
    part_.resize(size, 0.0f);
    const int phase = pixels[i][0] % lattice_.step;
    const int cell = pixels[i][0] / lattice_.step % lattice_.StripCells();
    const size_t at =
        static_cast<size_t>(row - lattice_.height) * static_cast<size_t>(Width()) + static_cast<size_t>(x);
    left_[at] = cell + phases.Side(phase);
    own_[at] = cell;
    part_[at] = phases.part[static_cast<size_t>(phase)];
    places_[i] = {row, x++};
  }
}

Plane Sites::PlaneOf(ConstFloatView pixels, absl::FunctionRef<float(size_t)> value, TaskPool* pool) const {
  Plane plane = Plane::Uninitialized(Width(), Rows());
  PutByPhase(pixels, lattice_, pool, &plane);
  for (int y = lattice_.height; y < Rows(); ++y) std::fill_n(plane.Row(y), Width(), 0.0f);
  for (size_t i = 0; i < places_.size(); ++i) At(i, &plane) = value(i);
  return plane;
}

absl::Span<const PointRun> Sites::RunsOf(int y, int column) const {
  const size_t strip = StripOf(y, column);
  return absl::MakeConstSpan(runs_).subspan(first_runs_[strip], first_runs_[strip + 1] - first_runs_[strip]);
}

PointCells Sites::CellsOf(const PointRun& run) const {
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(run.row - lattice_.height) * Width() + run.x;
  return {left_.data() + first, part_.data() + first, own_.data() + first, run.count};
}

}  // namespace lumifold::filter
