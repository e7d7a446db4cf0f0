#include "filter/manifold/manifold_filter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "filter/image/portable_math.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/manifold/recursive.h"

// The tree is walked level by level, so that the full-resolution planes are read twice a level and not twice
// a manifold. All that is done at full resolution is per pixel: distance to the manifolds, splat into the
// pixel's own cell, slice. Recursion is on cells.
namespace lumifold::filter {
namespace {

/// All manifolds of one level. Manifold i's children are 2i and 2i + 1 of the next level.
struct Level {
  std::vector<Manifold> manifolds;
  std::vector<Planes>
      splats;  // a manifold: C planes of cells with w * f, and one with w; blurred, they are Psi
  std::vector<Plane> weights;         // a manifold: w of each pixel
  std::vector<ClusterSums> children;  // of the next level's clusters; empty at the last level
};

class Filter {
 public:
  Filter(const Planes& signals, const Planes& features, ConstFloatView mask, const ManifoldParams& params,
         TaskPool* pool)
      : signals_(signals),
        features_(features),
        mask_(mask),
        params_(params),
        pool_(pool),
        lattice_(mask.width(), mask.height(), CellSize(params.sigma_s)),
        sigma_cells_(params.sigma_s / static_cast<float>(lattice_.step)),
        labels_(static_cast<size_t>(mask.width()) * static_cast<size_t>(mask.height()), 0),
        members_(mask.width(), mask.height()),
        sums_(MakePlanes(signals.size() + 1, mask.width(), mask.height())) {}

  Planes Run() {
    CopyPlane(mask_, members_.view());
    std::vector<Manifold> manifolds;
    manifolds.push_back(MakeManifold(RootSums(), nullptr, sigma_cells_, AxisSteps(1)));
    for (int depth = 1;; ++depth) {
      const bool is_last = depth == params_.height;
      Level level = Splat(std::move(manifolds), is_last);
      Blur(&level);
      Slice(level);
      if (is_last) break;
      manifolds = Children(level, AxisSteps(depth + 1));
    }
    return Quotient();
  }

 private:
  class BandTask;

  ClusterSums RootSums() const;
  Level Splat(std::vector<Manifold> manifolds, bool is_last);
  void Blur(Level* level) const;
  void Slice(const Level& level);
  std::vector<Manifold> Children(const Level& level, int axis_steps) const;
  /// Clusters of the last level are not split: they need no axis.
  int AxisSteps(int depth) const { return depth < params_.height ? params_.pca_iterations : 0; }
  Planes Quotient() const;
  void CellMeans(int row0, int row1, Plane* sums) const;
  uint8_t* Labels(int y) {
    return labels_.data() + static_cast<size_t>(y) * static_cast<size_t>(lattice_.width);
  }

  const Planes& signals_;
  const Planes& features_;
  const ConstFloatView mask_;
  const ManifoldParams params_;
  TaskPool* const pool_;
  const Lattice lattice_;
  const float sigma_cells_;
  std::vector<uint8_t> labels_;  // the manifold of the present level whose cluster a pixel belongs to
  Plane members_;                // mask times how far the pixel belongs to that cluster
  Planes sums_;  // over manifolds, at full resolution: w * Psi of each signal, and of the weight
};

/// Sums of cells in rows [row0, row1) to means over the pixels each really has.
void Filter::CellMeans(int row0, int row1, Plane* sums) const {
  for (int r = row0; r < row1; ++r) {
    for (int c = 0; c < lattice_.Columns(); ++c) {
      sums->At(c, r) /= static_cast<float>(lattice_.ColumnWidth(c) * lattice_.RowHeight(r));
    }
  }
}

/// The splat of one band of rows: what a task needs besides the filter's own state.
class Filter::BandTask {
 public:
  BandTask(Filter* filter, Level* level)
      : filter_(*filter),
        level_(*level),
        expander_(filter->lattice_),
        padded_(static_cast<size_t>(filter->lattice_.Columns() * filter->lattice_.step), 0.0f),
        square_(static_cast<size_t>(filter->lattice_.width)),
        along_(square_.size()),
        far_(square_.size()),
        side_(square_.size()) {}

  void Row(int y) {
    for (size_t i = 0; i < level_.manifolds.size(); ++i) {
      Measure(i, y);
      SplatSignals(i, y);
      if (!level_.children.empty()) ChooseChild(i, y);
    }
    if (!level_.children.empty()) SplatChildren(y);
  }

 private:
  /// Weights of the row's pixels on manifold i, and, where clusters are to be split, their position along its
  /// axis.
  void Measure(size_t i, int y) {
    const int width = filter_.lattice_.width;
    const Manifold& manifold = level_.manifolds[i];
    std::fill(square_.begin(), square_.end(), 0.0f);
    std::fill(along_.begin(), along_.end(), 0.0f);
    float* __restrict square = square_.data();
    float* __restrict along = along_.data();
    for (size_t k = 0; k < filter_.features_.size(); ++k) {
      const float* __restrict feature = filter_.features_[k].Row(y);
      const float* __restrict eta = expander_.Expand(manifold.eta[k], y);
      if (level_.children.empty()) {
        for (int x = 0; x < width; ++x) square[x] += (feature[x] - eta[x]) * (feature[x] - eta[x]);
        continue;
      }
      const float axis = manifold.axis[k];
      for (int x = 0; x < width; ++x) {
        const float offset = feature[x] - eta[x];
        square[x] += offset * offset;
        along[x] += axis * offset;
      }
    }
    float* __restrict weight = level_.weights[i].Row(y);
    for (int x = 0; x < width; ++x) {
      const float near = Exp(-square[x]);
      weight[x] = square[x] < kFarthest ? near : 0.0f;
    }
  }

  void SplatSignals(size_t i, int y) {
    const int width = filter_.lattice_.width;
    const float* __restrict mask = filter_.mask_.Row(y);
    const float* __restrict weight = level_.weights[i].Row(y);
    float* __restrict product = padded_.data();
    Planes& splat = level_.splats[i];
    const int cell_row = y / filter_.lattice_.step;
    for (size_t c = 0; c < filter_.signals_.size(); ++c) {
      const float* __restrict signal = filter_.signals_[c].Row(y);
      for (int x = 0; x < width; ++x) product[x] = mask[x] * weight[x] * signal[x];
      AddRowToCells(filter_.lattice_, product, splat[c].Row(cell_row));
    }
    for (int x = 0; x < width; ++x) product[x] = mask[x] * weight[x];
    AddRowToCells(filter_.lattice_, product, splat.back().Row(cell_row));
  }

  /// For the pixels of manifold i's cluster: which child they go to, and with what weight.
  void ChooseChild(size_t i, int y) {
    const uint8_t* labels = filter_.Labels(y);
    float* member = filter_.members_.Row(y);
    const float* weight = level_.weights[i].Row(y);
    for (size_t x = 0; x < square_.size(); ++x) {
      if (labels[x] != i) continue;
      member[x] *= std::min(1.0f, std::abs(along_[x]) * (1.0f / kSeam));
      far_[x] = member[x] * (1.0f - weight[x]);
      side_[x] = static_cast<uint8_t>(2 * i + (along_[x] >= 0 ? 1 : 0));
    }
  }

  void SplatChildren(int y) {
    const int step = filter_.lattice_.step;
    const int width = filter_.lattice_.width;
    std::copy(side_.begin(), side_.end(), filter_.Labels(y));
    std::vector<float*> cells(level_.children.size());
    for (size_t k = 0; k <= filter_.features_.size(); ++k) {
      const bool is_weight = k == filter_.features_.size();
      const float* feature = is_weight ? nullptr : filter_.features_[k].Row(y);
      for (size_t child = 0; child < cells.size(); ++child) {
        ClusterSums& sums = level_.children[child];
        cells[child] = (is_weight ? sums.weight : sums.weighted[k]).Row(y / step);
      }
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(x);
        cells[side_[at]][x / step] += is_weight ? far_[at] : far_[at] * feature[x];
      }
    }
  }

  Filter& filter_;
  Level& level_;
  RowExpander expander_;
  std::vector<float> padded_;  // a row of products, with zeros up to the end of the last cell
  std::vector<float> square_;  // squared distance from the manifold
  std::vector<float> along_;   // position along its axis
  std::vector<float> far_;     // member * (1 - w) at the pixel's own manifold
  std::vector<uint8_t> side_;  // the child the pixel goes to
};

ClusterSums Filter::RootSums() const {
  ClusterSums sums = MakeClusterSums(features_.size(), lattice_);
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    std::vector<float> product(static_cast<size_t>(lattice_.Columns() * lattice_.step), 0.0f);
    for (int y = y0; y < y1; ++y) {
      const float* mask = mask_.Row(y);
      for (size_t k = 0; k < features_.size(); ++k) {
        const float* feature = features_[k].Row(y);
        for (int x = 0; x < lattice_.width; ++x) product[static_cast<size_t>(x)] = mask[x] * feature[x];
        AddRowToCells(lattice_, product.data(), sums.weighted[k].Row(y / lattice_.step));
      }
      std::copy_n(mask, lattice_.width, product.begin());
      AddRowToCells(lattice_, product.data(), sums.weight.Row(y / lattice_.step));
    }
    const int row0 = y0 / lattice_.step;
    const int row1 = (y1 + lattice_.step - 1) / lattice_.step;
    for (Plane& plane : sums.weighted) CellMeans(row0, row1, &plane);
    CellMeans(row0, row1, &sums.weight);
  });
  return sums;
}

Level Filter::Splat(std::vector<Manifold> manifolds, bool is_last) {
  Level level;
  level.manifolds = std::move(manifolds);
  for (size_t i = 0; i < level.manifolds.size(); ++i) {
    level.splats.push_back(MakePlanes(signals_.size() + 1, lattice_.Columns(), lattice_.Rows()));
    level.weights.emplace_back(lattice_.width, lattice_.height);
    if (is_last) continue;
    for (int child = 0; child < 2; ++child)
      level.children.push_back(MakeClusterSums(features_.size(), lattice_));
  }
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    BandTask task(this, &level);
    for (int y = y0; y < y1; ++y) task.Row(y);
    const int row0 = y0 / lattice_.step;  // kBandRows is a multiple of the step: bands share no cells
    const int row1 = (y1 + lattice_.step - 1) / lattice_.step;
    for (Planes& splat : level.splats) {
      for (Plane& plane : splat) CellMeans(row0, row1, &plane);
    }
    for (ClusterSums& sums : level.children) {
      for (Plane& plane : sums.weighted) CellMeans(row0, row1, &plane);
      CellMeans(row0, row1, &sums.weight);
    }
  });
  return level;
}

void Filter::Blur(Level* level) const {
  ParallelFor(pool_, static_cast<int64_t>(level->manifolds.size()), [&](int64_t i) {
    const size_t at = static_cast<size_t>(i);
    GuidedLowPass(sigma_cells_, kBlurRange, level->manifolds[at].eta, &level->splats[at]);
  });
}

void Filter::Slice(const Level& level) {
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    RowExpander expander(lattice_);
    for (int y = y0; y < y1; ++y) {
      for (size_t i = 0; i < level.manifolds.size(); ++i) {
        const float* __restrict weight = level.weights[i].Row(y);
        for (size_t c = 0; c < sums_.size(); ++c) {
          const float* __restrict psi = expander.Expand(level.splats[i][c], y);
          float* __restrict sum = sums_[c].Row(y);
          for (int x = 0; x < lattice_.width; ++x) sum[x] += weight[x] * psi[x];
        }
      }
    }
  });
}

std::vector<Manifold> Filter::Children(const Level& level, int axis_steps) const {
  std::vector<Manifold> children(level.children.size());
  ParallelFor(pool_, static_cast<int64_t>(children.size()), [&](int64_t i) {
    const size_t at = static_cast<size_t>(i);
    children[at] = MakeManifold(level.children[at], &level.manifolds[at / 2].eta, sigma_cells_, axis_steps);
  });
  return children;
}

Planes Filter::Quotient() const {
  Planes result = MakePlanes(signals_.size(), lattice_.width, lattice_.height);
  ForEachBand(pool_, lattice_.height, [&](int, int y0, int y1) {
    for (size_t c = 0; c < result.size(); ++c) {
      for (int y = y0; y < y1; ++y) {
        const float* sum = sums_[c].Row(y);
        const float* total = sums_.back().Row(y);
        const float* own = signals_[c].Row(y);
        float* out = result[c].Row(y);
        for (int x = 0; x < lattice_.width; ++x)
          out[x] = total[x] < kLeastWeight ? own[x] : sum[x] / total[x];
      }
    }
  });
  return result;
}

}  // namespace

int CellSize(float sigma_s) {
  int size = sigma_s >= 2 ? 2 : 1;
  while (static_cast<float>(8 * size) <= sigma_s && 2 * size <= kBandRows) size *= 2;
  return size;
}

Planes ManifoldFilter(const Planes& signals, const Planes& features, ConstFloatView mask,
                      const ManifoldParams& params, TaskPool* pool) {
  LUMIFOLD_CHECK(!features.empty() && params.height >= 1 && params.height <= 8 &&
                 params.pca_iterations >= 1 && params.sigma_s > 0);
  if (mask.width() == 0 || mask.height() == 0) return MakePlanes(signals.size(), mask.width(), mask.height());
  return Filter(signals, features, mask, params, pool).Run();
}

}  // namespace lumifold::filter
