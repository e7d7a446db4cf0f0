#include "filter/manifold/nlm_space.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <Eigen/Dense>

#include "filter/image/mix_bits.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/fit_kernels.h"
#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {
namespace {

/// Patches the covariance is taken over, about: enough for some hundred dimensions, few enough to cost
/// little.
constexpr int kLatticePatches = 6000;
/// So many stay in the first cache while their products are added.
constexpr size_t kPatchesAtATime = 48;
/// Axes that are iterated beside those that are asked for: the last of these converge faster.
constexpr int kSpareAxes = 4;
constexpr int kIterations = 12;

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

/// Writes a patch, times the window, and a 1 behind it.
void CopyPatch(const Planes& color, const std::vector<float>& window, int radius, int x, int y, float* to) {
  for (const Plane& plane : color) {
    size_t tap = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      const float* row = plane.Row(std::clamp(y + dy, 0, plane.height() - 1));
      for (int dx = -radius; dx <= radius; ++dx)
        *to++ = window[tap++] * row[std::clamp(x + dx, 0, plane.width() - 1)];
    }
  }
  *to = 1;
}

/// Adds the products of the patches of rows [first, last) of the lattice: entry j of row i, j <= i, at
/// sums[i * size + j]. `size`: of a patch with what is behind it, padded.
void AddProducts(const Planes& color, ConstFloatView mask, const PatchLattice& lattice, size_t first,
                 size_t last, size_t size, float* sums) {
  std::vector<float> patches(kPatchesAtATime * size);
  size_t count = 0;
  const auto add = [&] {
    AddFitRows({patches.data(), patches.data(), count, size, 0, size}, sums);
    count = 0;
  };
  for (size_t row = first; row < last; ++row) {
    for (const int x : lattice.columns) {
      if (!(mask.At(x, lattice.rows[row]) > 0)) continue;
      CopyPatch(color, lattice.window, lattice.radius, x, lattice.rows[row], &patches[count * size]);
      if (++count == kPatchesAtATime) add();
    }
  }
  add();
}

Eigen::MatrixXd CovarianceOf(const PatchProducts& products) {
  const auto n = static_cast<Eigen::Index>(products.dimensions);
  const auto entry = [&](Eigen::Index i, Eigen::Index j) {
    return products.sums[static_cast<size_t>(i * (i + 1) / 2 + j)];
  };
  const double count = entry(n, n);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  if (!(count > 0)) return covariance;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      covariance(i, j) = entry(i, j) / count - entry(n, i) / count * (entry(n, j) / count);
      covariance(j, i) = covariance(i, j);
    }
  }
  return covariance;
}

/// Principal axes as columns, by falling variance.
struct Axes {
  Eigen::VectorXd variances;
  Eigen::MatrixXd columns;
};

/// By orthogonal iteration of `count` axes.
Axes PrincipalAxes(const Eigen::MatrixXd& covariance, Eigen::Index count) {
  const Eigen::Index n = covariance.rows();
  Eigen::MatrixXd axes(n, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    for (Eigen::Index i = 0; i < n; ++i)
      axes(i, k) = MixBits(static_cast<uint64_t>(k * n + i) + 1) % 2 == 0 ? 1.0 : -1.0;
  }
  for (int step = 0; step < kIterations; ++step) {
    const Eigen::HouseholderQR<Eigen::MatrixXd> orthogonal(covariance * axes);
    axes = orthogonal.householderQ() * Eigen::MatrixXd::Identity(n, count);
  }
  const Eigen::MatrixXd within = axes.transpose() * covariance * axes;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(within);
  return {solver.eigenvalues().reverse(), axes * solver.eigenvectors().rowwise().reverse()};
}

/// `total`: of all axes' variances.
int DimensionsFor(const Eigen::VectorXd& variances, double total, const PatchParams& params) {
  const int most = std::min(params.most_dimensions, static_cast<int>(variances.size()));
  double explained = 0;
  for (int k = 0; k < most; ++k) {
    explained += std::max(0.0, variances[k]);
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

PatchLattice::PatchLattice(int width, int height, size_t channels, int patch_radius)
    : radius(patch_radius), window(Window(patch_radius, channels)), dimensions(channels * window.size()) {
  const int step =
      std::max(2, static_cast<int>(std::sqrt(static_cast<double>(width) * height / kLatticePatches)));
  columns = LatticePoints(width, step);
  rows = LatticePoints(height, step);
}

PatchProducts PatchProductsOf(const Planes& color, ConstFloatView mask, const PatchLattice& lattice,
                              TaskPool* pool) {
  const size_t size = (lattice.dimensions + kFitRowPadding) / kFitRowPadding * kFitRowPadding;
  std::vector<std::vector<float>> parts(lattice.Parts());
  ParallelFor(pool, static_cast<int64_t>(parts.size()), [&](int64_t task) {
    std::vector<float>& part = parts[static_cast<size_t>(task)];
    part.resize(size * size);
    const size_t first = static_cast<size_t>(task) * PatchLattice::kLatticeRows;
    AddProducts(color, mask, lattice, first,
                std::min(first + PatchLattice::kLatticeRows, lattice.rows.size()), size, part.data());
  });
  PatchProducts products(lattice.dimensions);
  for (const std::vector<float>& part : parts) {
    double* to = products.sums.data();
    for (size_t i = 0; i <= lattice.dimensions; ++i) {
      for (size_t j = 0; j <= i; ++j) *to++ += static_cast<double>(part[i * size + j]);
    }
  }
  return products;
}

PatchBasis BasisOf(const PatchProducts& products, const PatchLattice& lattice, const PatchParams& params) {
  const Eigen::MatrixXd covariance = CovarianceOf(products);
  const Eigen::Index n = covariance.rows();
  const Axes axes = PrincipalAxes(covariance, std::min<Eigen::Index>(n, params.most_dimensions + kSpareAxes));
  PatchBasis basis;
  basis.radius = params.radius;
  basis.dimensions = DimensionsFor(axes.variances, covariance.diagonal().sum(), params);
  for (int k = 0; k < basis.dimensions; ++k) {
    const Eigen::VectorXd axis = axes.columns.col(k);
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    const double sign = axis[largest] < 0 ? -1.0 : 1.0;
    for (Eigen::Index i = 0; i < n; ++i) {
      basis.kernels.push_back(static_cast<float>(sign * axis[i]) *
                              lattice.window[static_cast<size_t>(i) % lattice.window.size()]);
    }
  }
  return basis;
}

PatchBasis FitPatchBasis(const Planes& color, ConstFloatView mask, const PatchParams& params,
                         TaskPool* pool) {
  const PatchLattice lattice(mask.width(), mask.height(), color.size(), params.radius);
  return BasisOf(PatchProductsOf(color, mask, lattice, pool), lattice, params);
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
