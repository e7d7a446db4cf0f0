#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumifold::render {

/// Piecewise-constant distributions over [0, 1), all of the same number of cells of equal width, sampled by
/// inversion, which preserves the stratification of the random numbers. A guide table tells where the search
/// for a number begins: on average four cells are looked at. Threads: safe concurrently after the last
/// Fill(). Sources: Pharr, Jakob & Humphreys 2023, A.5; guide table: Chen & Asau 1974.
class CellDistributions {
 public:
  CellDistributions() = default;
  /// Both numbers are above 0. Every distribution has to be filled.
  CellDistributions(int count, int cells);

  /// Sets a distribution in proportion to `weights`, one for each cell; uniform if all are 0. Returns their
  /// sum.
  double Fill(int distribution, const double* weights);

  struct Pick {
    int cell;
    float fraction;  // position within the cell, 0 to 1
  };

  /// The cell that `u` in [0, 1) selects; never one of weight 0.
  Pick Sample(int distribution, float u) const {
    const float* cdf = &cdf_[First(distribution)];
    uint32_t cell = guide_[static_cast<size_t>(distribution) * guide_cells_ +
                           static_cast<size_t>(u * static_cast<float>(guide_cells_))];
    while (cell + 1 < cells_ && cdf[cell + 1] <= u) ++cell;
    const float share = cdf[cell + 1] - cdf[cell];
    const float fraction = (u - cdf[cell]) / share;
    return {static_cast<int>(cell), share > 0 ? (fraction < 1 ? fraction : 1.0f) : 0.5f};
  }

  /// Probability of a cell.
  float Share(int distribution, int cell) const {
    const float* cdf = &cdf_[First(distribution) + static_cast<size_t>(cell)];
    return cdf[1] - cdf[0];
  }

  uint64_t bytes() const { return cdf_.size() * sizeof(float) + guide_.size() * sizeof(uint32_t); }

 private:
  size_t First(int distribution) const { return static_cast<size_t>(distribution) * (cells_ + 1); }

  size_t cells_ = 0;
  size_t guide_cells_ = 0;       // a power of two: u times it is exact
  std::vector<float> cdf_;       // of each distribution cells_ + 1, from 0 to 1
  std::vector<uint32_t> guide_;  // the cell that the least number of each of guide_cells_ parts selects
};

}  // namespace lumifold::render
