#include "filter/manifold/manifold_slow.h"

#include <cmath>
#include <functional>

#include "filter/manifold/manifold_tree.h"

namespace lumifold::filter {
namespace {

/// A grid of numbers, of pixels or of cells.
struct Grid {
  int width = 0;
  int height = 0;
  std::vector<double> values;

  Grid(int w, int h) : width(w), height(h), values(static_cast<size_t>(w) * static_cast<size_t>(h), 0.0) {}
  double& At(int x, int y) {
    return values[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
  }
  double At(int x, int y) const {
    return values[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
  }
};
using Grids = std::vector<Grid>;

Grid FromView(ConstFloatView view) {
  Grid grid(view.width(), view.height());
  for (int y = 0; y < grid.height; ++y) {
    for (int x = 0; x < grid.width; ++x) grid.At(x, y) = static_cast<double>(view.At(x, y));
  }
  return grid;
}

Grid Times(const Grid& a, const Grid& b) {
  Grid product = a;
  for (size_t i = 0; i < a.values.size(); ++i) product.values[i] *= b.values[i];
  return product;
}

/// Weight between neighbours, by position: (x, y) and the neighbour before it along the axis.
using Link = std::function<double(int x, int y, int dx, int dy)>;

void Recurse(const Link& link, Grid* g) {
  for (int y = 0; y < g->height; ++y) {
    for (int x = 1; x < g->width; ++x) g->At(x, y) += link(x, y, 1, 0) * (g->At(x - 1, y) - g->At(x, y));
    for (int x = g->width - 2; x >= 0; --x)
      g->At(x, y) += link(x + 1, y, 1, 0) * (g->At(x + 1, y) - g->At(x, y));
  }
  for (int x = 0; x < g->width; ++x) {
    for (int y = 1; y < g->height; ++y) g->At(x, y) += link(x, y, 0, 1) * (g->At(x, y - 1) - g->At(x, y));
    for (int y = g->height - 2; y >= 0; --y)
      g->At(x, y) += link(x, y + 1, 0, 1) * (g->At(x, y + 1) - g->At(x, y));
  }
}

class SlowFilter {
 public:
  SlowFilter(const Planes& signals, const Planes& features, ConstFloatView mask, const ManifoldParams& params)
      : params_(params),
        mask_(FromView(mask)),
        step_(CellSize(params.sigma_s)),
        sigma_(static_cast<double>(params.sigma_s) / step_) {
    for (const Plane& plane : signals) signals_.push_back(FromView(plane.view()));
    for (const Plane& plane : features) features_.push_back(FromView(plane.view()));
    sums_.assign(signals_.size() + 1, Grid(mask_.width, mask_.height));
  }

  Planes Run() {
    const Grids root = Heights(mask_, nullptr);
    Visit(root, Axis(mask_, root), mask_, 1);
    Planes result = MakePlanes(signals_.size(), mask_.width, mask_.height);
    for (size_t c = 0; c < result.size(); ++c) {
      for (int y = 0; y < mask_.height; ++y) {
        for (int x = 0; x < mask_.width; ++x) {
          const double total = sums_.back().At(x, y);
          const double value =
              total < static_cast<double>(kLeastWeight) ? signals_[c].At(x, y) : sums_[c].At(x, y) / total;
          result[c].At(x, y) = static_cast<float>(value);
        }
      }
    }
    return result;
  }

 private:
  Grid Down(const Grid& fine) const {
    Grid cells((fine.width + step_ - 1) / step_, (fine.height + step_ - 1) / step_);
    for (int r = 0; r < cells.height; ++r) {
      for (int c = 0; c < cells.width; ++c) {
        double sum = 0;
        int count = 0;
        for (int y = r * step_; y < std::min((r + 1) * step_, fine.height); ++y) {
          for (int x = c * step_; x < std::min((c + 1) * step_, fine.width); ++x, ++count)
            sum += fine.At(x, y);
        }
        cells.At(c, r) = sum / count;
      }
    }
    return cells;
  }

  double Up(const Grid& cells, int x, int y) const {
    const double px = (x + 0.5) / step_ - 0.5;
    const double py = (y + 0.5) / step_ - 0.5;
    const int cx = static_cast<int>(std::floor(px));
    const int cy = static_cast<int>(std::floor(py));
    const auto at = [&](int i, int j) {
      return cells.At(std::clamp(i, 0, cells.width - 1), std::clamp(j, 0, cells.height - 1));
    };
    const double fx = px - cx;
    const double fy = py - cy;
    return (1 - fy) * ((1 - fx) * at(cx, cy) + fx * at(cx + 1, cy)) +
           fy * ((1 - fx) * at(cx, cy + 1) + fx * at(cx + 1, cy + 1));
  }

  /// eta of the cluster that has `weight`.
  Grids Heights(const Grid& weight, const Grids* parent) const {
    const Link uniform = [this](int, int, int, int) { return std::exp(-std::sqrt(2.0) / sigma_); };
    Grid mass = Down(weight);
    Recurse(uniform, &mass);
    Grids eta;
    for (size_t k = 0; k < features_.size(); ++k) {
      Grid height = Down(Times(weight, features_[k]));
      Recurse(uniform, &height);
      for (size_t i = 0; i < height.values.size(); ++i) {
        const bool is_empty = mass.values[i] < static_cast<double>(kLeastClusterMass);
        height.values[i] =
            is_empty ? (parent != nullptr ? (*parent)[k].values[i] : 0.0) : height.values[i] / mass.values[i];
      }
      eta.push_back(height);
    }
    return eta;
  }

  std::vector<double> Axis(const Grid& weight, const Grids& eta) const {
    const size_t d = features_.size();
    Grid mass = Down(weight);
    const int row_step = std::max(1, mass.height / kAxisRows);
    for (int y = 0; y < mass.height; ++y) {
      for (int x = 0; x < mass.width && y % row_step != 0; ++x) mass.At(x, y) = 0;
    }
    Grids offsets;
    for (size_t k = 0; k < d; ++k) {
      Grid offset = Down(Times(weight, features_[k]));
      for (size_t i = 0; i < offset.values.size(); ++i) {
        const bool is_empty = mass.values[i] < static_cast<double>(kLeastClusterMass);
        offset.values[i] = is_empty ? 0.0 : offset.values[i] / mass.values[i] - eta[k].values[i];
      }
      offsets.push_back(offset);
    }
    std::vector<double> axis(d);
    for (size_t k = 0; k < d; ++k) axis[k] = StartComponent(k);
    double spread = 0;
    double total = 0;
    for (size_t i = 0; i < mass.values.size(); ++i) {
      total += mass.values[i];
      for (size_t k = 0; k < d; ++k) spread += mass.values[i] * offsets[k].values[i] * offsets[k].values[i];
    }
    if (!(spread > kLeastSpread * total)) return axis;
    for (int step = 0; step < params_.pca_iterations; ++step) {
      std::vector<double> next(d, 0.0);
      for (size_t i = 0; i < mass.values.size(); ++i) {
        double along = 0;
        for (size_t k = 0; k < d; ++k) along += offsets[k].values[i] * axis[k];
        for (size_t k = 0; k < d; ++k) next[k] += mass.values[i] * along * offsets[k].values[i];
      }
      double length = 0;
      for (const double x : next) length += x * x;
      if (!(length > 0)) break;
      for (size_t k = 0; k < d; ++k) axis[k] = next[k] / std::sqrt(length);
    }
    return axis;
  }

  /// `member`: how far each pixel belongs to the cluster.
  void Visit(const Grids& eta, const std::vector<double>& axis, const Grid& member, int depth) {
    Grid weight(mask_.width, mask_.height);
    Grid sides[2] = {member, member};
    size_t i = 0;
    for (int y = 0; y < mask_.height; ++y) {
      for (int x = 0; x < mask_.width; ++x, ++i) {
        double square = 0;
        double along = 0;
        for (size_t k = 0; k < features_.size(); ++k) {
          const double offset = features_[k].At(x, y) - Up(eta[k], x, y);
          square += offset * offset;
          along += axis[k] * offset;
        }
        weight.values[i] = square < static_cast<double>(kFarthest) ? std::exp(-square) : 0.0;
        sides[along >= 0 ? 0 : 1].values[i] = 0;
        sides[along >= 0 ? 1 : 0].values[i] *= std::min(1.0, std::abs(along) / static_cast<double>(kSeam));
      }
    }
    SplatBlurSlice(eta, weight);
    if (depth == params_.height) return;
    for (const Grid& side : sides) {
      Grid child = side;
      for (size_t p = 0; p < child.values.size(); ++p) child.values[p] *= 1 - weight.values[p];
      const Grids child_eta = Heights(child, &eta);
      Visit(child_eta, Axis(child, child_eta), side, depth + 1);
    }
  }

  void SplatBlurSlice(const Grids& eta, const Grid& weight) {
    const double stretch = sigma_ / static_cast<double>(kBlurRange);
    const Link guided = [&](int x, int y, int dx, int dy) {
      double square = 0;
      for (const Grid& height : eta) square += std::pow(height.At(x, y) - height.At(x - dx, y - dy), 2);
      return std::exp(-std::sqrt(2.0) / sigma_ * std::sqrt(1 + stretch * stretch * square));
    };
    const Grid splat = Times(mask_, weight);
    for (size_t c = 0; c < sums_.size(); ++c) {
      Grid psi = Down(c < signals_.size() ? Times(splat, signals_[c]) : splat);
      Recurse(guided, &psi);
      for (int y = 0; y < mask_.height; ++y) {
        for (int x = 0; x < mask_.width; ++x) sums_[c].At(x, y) += weight.At(x, y) * Up(psi, x, y);
      }
    }
  }

  const ManifoldParams params_;
  const Grid mask_;
  const int step_;
  const double sigma_;
  Grids signals_;
  Grids features_;
  Grids sums_;  // over manifolds: w * Psi of each signal, and of the weight
};

}  // namespace

Planes ManifoldFilterSlow(const Planes& signals, const Planes& features, ConstFloatView mask,
                          const ManifoldParams& params) {
  return SlowFilter(signals, features, mask, params).Run();
}

}  // namespace lumifold::filter
