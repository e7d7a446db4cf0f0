#include "filter/layers/nlm_space.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/Dense>

#include "filter/image/portable_math.h"
#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {
namespace {

/// Patches the covariance is taken over, about: enough for some hundred dimensions, few enough to cost
/// little.
constexpr int kLatticePatches = 6000;

/// Gaussian of variance radius/2, scaled so that its squares over `channels` copies sum to 1.
std::vector<float> Window(int radius, size_t channels) {
  std::vector<float> window;
  float squares = 0;
  for (int dy = -radius; dy <= radius; ++dy) {
    for (int dx = -radius; dx <= radius; ++dx) {
      window.push_back(Exp(-static_cast<float>(dx * dx + dy * dy) / static_cast<float>(radius)));
      squares += window.back() * window.back();
    }
  }
  const float scale = 1.0f / std::sqrt(squares * static_cast<float>(channels));
  for (float& w : window) w *= scale;
  return window;
}

/// Pixel coordinates of a lattice that lies symmetric in [0, size).
std::vector<int> LatticePoints(int size, int step) {
  std::vector<int> points;
  for (int p = (size - 1) % step / 2; p < size; p += step) points.push_back(p);
  return points;
}

/// First and second moments of patches.
struct Moments {
  double count = 0;
  Eigen::VectorXd sum;
  Eigen::MatrixXd products;

  explicit Moments(Eigen::Index n) : sum(Eigen::VectorXd::Zero(n)), products(Eigen::MatrixXd::Zero(n, n)) {}
};

Eigen::VectorXd PatchAt(const Planes& color, const std::vector<float>& window, int radius, int x, int y) {
  Eigen::VectorXd patch(static_cast<Eigen::Index>(window.size() * color.size()));
  Eigen::Index at = 0;
  for (const Plane& plane : color) {
    size_t tap = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      const float* row = plane.Row(std::clamp(y + dy, 0, plane.height() - 1));
      for (int dx = -radius; dx <= radius; ++dx) {
        patch[at++] = static_cast<double>(window[tap++] * row[std::clamp(x + dx, 0, plane.width() - 1)]);
      }
    }
  }
  return patch;
}

Moments LatticeMoments(const Planes& color, ConstFloatView mask, const std::vector<float>& window, int radius,
                       TaskPool* pool) {
  const Eigen::Index n = static_cast<Eigen::Index>(window.size() * color.size());
  const double pixels = static_cast<double>(mask.width()) * mask.height();
  const int step = std::max(2, static_cast<int>(std::sqrt(pixels / kLatticePatches)));
  const std::vector<int> columns = LatticePoints(mask.width(), step);
  const std::vector<int> rows = LatticePoints(mask.height(), step);
  constexpr size_t kRowsPerTask = 8;
  std::vector<Moments> parts((rows.size() + kRowsPerTask - 1) / kRowsPerTask, Moments(n));
  ParallelFor(pool, static_cast<int64_t>(parts.size()), [&](int64_t task) {
    Moments& part = parts[static_cast<size_t>(task)];
    const size_t first = static_cast<size_t>(task) * kRowsPerTask;
    const size_t last = std::min(first + kRowsPerTask, rows.size());
    Eigen::MatrixXd patches(n, static_cast<Eigen::Index>((last - first) * columns.size()));
    Eigen::Index count = 0;
    for (size_t row = first; row < last; ++row) {
      for (const int x : columns) {
        if (mask.At(x, rows[row]) > 0) patches.col(count++) = PatchAt(color, window, radius, x, rows[row]);
      }
    }
    const auto used = patches.leftCols(count);
    if (count == 0) return;  // Eigen divides by the size of what it multiplies
    part.count = static_cast<double>(count);
    part.sum = used.rowwise().sum();
    part.products.selfadjointView<Eigen::Lower>().rankUpdate(used);
  });
  Moments total(n);
  for (const Moments& part : parts) {
    total.count += part.count;
    total.sum += part.sum;
    total.products += part.products;
  }
  return total;
}

int DimensionsFor(const Eigen::VectorXd& ascending_variances, const PatchParams& params) {
  const int n = static_cast<int>(ascending_variances.size());
  const double total = ascending_variances.cwiseMax(0.0).sum();
  const int most = std::min(params.most_dimensions, n);
  double explained = 0;
  for (int k = 0; k < most; ++k) {
    explained += std::max(0.0, ascending_variances[n - 1 - k]);
    if (k + 1 >= params.least_dimensions && explained >= params.explained_variance * total) return k + 1;
  }
  return most;
}

/// A picture with `radius` copies of its edge pixels around it.
Plane Padded(const Plane& plane, int radius) {
  Plane padded = Plane::Uninitialized(plane.width() + 2 * radius, plane.height() + 2 * radius);
  for (int y = 0; y < padded.height(); ++y) {
    const float* from = plane.Row(std::clamp(y - radius, 0, plane.height() - 1));
    float* to = padded.Row(y);
    std::fill_n(to, radius, from[0]);
    std::copy_n(from, plane.width(), to + radius);
    std::fill_n(to + radius + plane.width(), radius, from[plane.width() - 1]);
  }
  return padded;
}

}  // namespace

PatchBasis FitPatchBasis(const Planes& color, ConstFloatView mask, const PatchParams& params,
                         TaskPool* pool) {
  const std::vector<float> window = Window(params.radius, color.size());
  Moments moments = LatticeMoments(color, mask, window, params.radius, pool);
  const Eigen::Index n = moments.sum.size();
  if (moments.count > 0) {
    const Eigen::VectorXd mean = moments.sum / moments.count;
    moments.products = moments.products / moments.count - mean * mean.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(moments.products);  // reads the lower half
  PatchBasis basis;
  basis.radius = params.radius;
  basis.dimensions = DimensionsFor(solver.eigenvalues(), params);
  for (int k = 0; k < basis.dimensions; ++k) {
    const Eigen::VectorXd axis = solver.eigenvectors().col(n - 1 - k);
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    const double sign = axis[largest] < 0 ? -1.0 : 1.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      basis.kernels.push_back(static_cast<float>(sign * axis[i]) *
                              window[static_cast<size_t>(i) % window.size()]);
    }
  }
  return basis;
}

Planes ProjectPatches(const Planes& color, const PatchBasis& basis, TaskPool* pool) {
  const int width = color[0].width();
  const int height = color[0].height();
  const int side = 2 * basis.radius + 1;
  Planes padded(color.size());
  ParallelFor(pool, static_cast<int64_t>(color.size()), [&](int64_t i) {
    padded[static_cast<size_t>(i)] = Padded(color[static_cast<size_t>(i)], basis.radius);
  });
  Planes coordinates = MakeUninitializedPlanes(static_cast<size_t>(basis.dimensions), width, height);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    std::vector<const float*> pixels;
    for (int y = y0; y < y1; ++y) {
      pixels.clear();
      for (const Plane& plane : padded) {
        for (int dy = 0; dy < side; ++dy) pixels.push_back(plane.Row(y + dy));
      }
      const float* taps = basis.kernels.data();
      for (Plane& coordinate : coordinates) {
        CorrelateRows({taps, side, pixels.data(), pixels.size(), width}, coordinate.Row(y));
        taps += pixels.size() * static_cast<size_t>(side);
      }
    }
  });
  return coordinates;
}

}  // namespace lumifold::filter
