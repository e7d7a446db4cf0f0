#include "tests/unit/filter/manifold_oracle.h"

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

Planes Quotients(const Grids& signals, const Grids& sums) {
  Planes result = MakePlanes(signals.size(), signals[0].width, signals[0].height);
  for (size_t c = 0; c < result.size(); ++c) {
    for (int y = 0; y < signals[c].height; ++y) {
      for (int x = 0; x < signals[c].width; ++x) {
        const double total = sums.back().At(x, y);
        const bool is_lost = total < static_cast<double>(kLeastWeight);
        result[c].At(x, y) = static_cast<float>(is_lost ? signals[c].At(x, y) : sums[c].At(x, y) / total);
      }
    }
  }
  return result;
}

SlicedPoints PointQuotients(const Grids& sums) {
  SlicedPoints points;
  for (int pixel = 0; pixel < sums[0].height; ++pixel) {
    for (size_t c = 0; c < sums.size(); ++c) {
      for (int j = 0; j < sums[0].width; ++j) {
        const double total = sums.back().At(j, pixel);
        const bool is_lost = total < static_cast<double>(kLeastWeight);
        const bool is_weight = c + 1 == sums.size();
        const double value = is_weight ? total : sums[c].At(j, pixel) / total;
        (is_weight ? points.weights : points.values).push_back(is_lost ? 0.0f : static_cast<float>(value));
      }
    }
  }
  return points;
}

class SlowFilter {
 public:
  SlowFilter(const Planes& signals, const Planes& features, ConstFloatView mask, const ManifoldParams& params,
             float reach, const SlicePoints* points)
      : params_(params),
        points_(points),
        mask_(FromView(mask)),
        splat_mask_(mask_),
        total_(mask_.width, mask_.height),
        is_weighing_(params.keeps_mass),
        step_(CellOf(params)),
        sigma_(static_cast<double>(params.sigma_s) / step_),
        blur_sigma_(static_cast<double>(reach) / step_),
        sums_(signals.size() + 1, Grid(mask_.width, mask_.height)) {
    for (const Plane& plane : signals) signals_.push_back(FromView(plane.view()));
    for (const Plane& plane : features) features_.push_back(FromView(plane.view()));
    const Grid no_points(points != nullptr ? static_cast<int>(points->samples) : 0,
                         points != nullptr ? static_cast<int>(points->pixels.size()) : 0);
    point_sums_.assign(signals.size() + 1, no_points);
    if (points == nullptr || points->signals.empty()) return;
    point_masses_.assign(points->weights.begin(), points->weights.end());
    point_totals_.assign(point_masses_.size(), 0.0);
    for (size_t i = 0; i < point_masses_.size(); ++i) {
      const auto [x, y] = points->pixels[i / points->samples];
      if (points->weights[i] > 0) splat_mask_.At(x, y) = 0;
    }
  }

  ManifoldResult Run() {
    if (params_.keeps_mass) {  // a walk through the tree for the sums of all weights first
      VisitRoot();
      for (size_t i = 0; i < splat_mask_.values.size(); ++i)
        splat_mask_.values[i] /= MassDivisor(total_.values[i]);
      for (size_t i = 0; i < point_masses_.size(); ++i) point_masses_[i] /= MassDivisor(point_totals_[i]);
    }
    is_weighing_ = false;
    VisitRoot();
    return {Quotients(signals_, sums_), points_ != nullptr ? PointQuotients(point_sums_) : SlicedPoints{}};
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
        const double drawn = parent != nullptr ? static_cast<double>(kParentMass) : 0.0;
        const double sum = height.values[i] + (parent != nullptr ? drawn * (*parent)[k].values[i] : 0.0);
        const bool is_empty = mass.values[i] + drawn < static_cast<double>(kLeastClusterMass);
        height.values[i] = is_empty ? 0.0 : sum / (mass.values[i] + drawn);
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

  void VisitRoot() {
    const Grids root = Heights(mask_, nullptr);
    Visit(root, Axis(mask_, root), mask_, 1);
  }

  static double MassDivisor(double total) { return std::min(1.0, total) + static_cast<double>(kLeastTotal); }

  void AddToTotals(const Grids& eta, const Grid& weight) {
    for (size_t i = 0; i < weight.values.size(); ++i) total_.values[i] += weight.values[i];
    for (size_t i = 0; i < point_totals_.size(); ++i)
      point_totals_[i] += PointWeight(eta, i / points_->samples, i % points_->samples);
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
    if (is_weighing_)
      AddToTotals(eta, weight);
    else
      SplatBlurSlice(eta, weight);
    if (depth == params_.height) return;
    for (const Grid& side : sides) {
      Grid child = side;
      for (size_t p = 0; p < child.values.size(); ++p) child.values[p] *= 1 - weight.values[p];
      const Grids child_eta = Heights(child, &eta);
      Visit(child_eta, Axis(child, child_eta), side, depth + 1);
    }
  }

  /// Weight on the manifold of point j of one of the pixels that have points.
  double PointWeight(const Grids& eta, size_t pixel, size_t j) const {
    const auto [x, y] = points_->pixels[pixel];
    const size_t shared = eta.size() - points_->own_features;
    double square = 0;
    for (size_t k = 0; k < eta.size(); ++k) {
      const double height = Up(eta[k], x, y);
      if (k < shared) {
        square += std::pow(features_[k].At(x, y) - height, 2) / static_cast<double>(points_->pixel_divisor);
        continue;
      }
      const size_t at = (pixel * points_->own_features + k - shared) * points_->samples + j;
      square += std::pow(static_cast<double>(points_->features[at]) - height, 2);
    }
    return square < static_cast<double>(kFarthest) ? std::exp(-square) : 0.0;
  }

  void SliceAtPoints(const Grids& eta, const Grid& psi, Grid* sums) const {
    for (int pixel = 0; pixel < sums->height; ++pixel) {
      const auto [x, y] = points_->pixels[static_cast<size_t>(pixel)];
      for (int j = 0; j < sums->width; ++j)
        sums->At(j, pixel) +=
            PointWeight(eta, static_cast<size_t>(pixel), static_cast<size_t>(j)) * Up(psi, x, y);
    }
  }

  bool HasSignals() const { return points_ != nullptr && !points_->signals.empty(); }

  /// Adds signal c of the points to the cells, or their weights where c is the number of signals.
  void SplatPoints(const Grids& eta, size_t c, Grid* cells) const {
    for (size_t i = 0; i < point_masses_.size(); ++i) {
      const size_t pixel = i / points_->samples;
      const size_t j = i % points_->samples;
      const auto [x, y] = points_->pixels[pixel];
      const int column = x / step_;
      const int row = y / step_;
      const int area =
          std::min(step_, mask_.width - column * step_) * std::min(step_, mask_.height - row * step_);
      const double signal =
          c < signals_.size()
              ? static_cast<double>(points_->signals[(pixel * signals_.size() + c) * points_->samples + j])
              : 1.0;
      cells->At(column, row) += point_masses_[i] * PointWeight(eta, pixel, j) * signal / area;
    }
  }

  void SplatBlurSlice(const Grids& eta, const Grid& weight) {
    const Grid splat = Times(splat_mask_, weight);
    const double stretch = blur_sigma_ / static_cast<double>(kBlurRange);
    const Link guided = [&](int x, int y, int dx, int dy) {
      double square = 0;
      for (const Grid& height : eta) square += std::pow(height.At(x, y) - height.At(x - dx, y - dy), 2);
      return std::exp(-std::sqrt(2.0) / blur_sigma_ * std::sqrt(1 + stretch * stretch * square));
    };
    for (size_t c = 0; c <= signals_.size(); ++c) {
      Grid psi = Down(c < signals_.size() ? Times(splat, signals_[c]) : splat);
      if (HasSignals()) SplatPoints(eta, c, &psi);
      Recurse(guided, &psi);
      for (int y = 0; y < mask_.height; ++y) {
        for (int x = 0; x < mask_.width; ++x) sums_[c].At(x, y) += weight.At(x, y) * Up(psi, x, y);
      }
      SliceAtPoints(eta, psi, &point_sums_[c]);
    }
  }

  const ManifoldParams params_;
  const SlicePoints* const points_;
  const Grid mask_;
  Grid splat_mask_;  // without the pixels that their points stand for
  Grid total_;       // of the pixels' weights on all manifolds
  bool is_weighing_;
  std::vector<double> point_masses_;
  std::vector<double> point_totals_;
  const int step_;
  const double sigma_;       // cells
  const double blur_sigma_;  // cells
  Grids signals_;
  Grids features_;
  Grids sums_;        // over manifolds of w * Psi of each signal, and of the weight
  Grids point_sums_;  // the same at the points: samples x pixels
};

}  // namespace

ManifoldResult ManifoldFilterOracle(const Planes& signals, const Planes& features, ConstFloatView mask,
                                    const ManifoldParams& params, float reach, const SlicePoints* points) {
  return SlowFilter(signals, features, mask, params, reach, points).Run();
}

}  // namespace lumifold::filter
