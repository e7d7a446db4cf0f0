#include "filter/baselines/patch_regression.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <memory>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "filter/image/planes.h"
#include "filter/image/portable_math.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 9;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kOffsets = kSide * kSide;
constexpr int kPaddedOffsets = (kOffsets + 7) / 8 * 8;
constexpr int kPatchRadius = 3;
constexpr int kPatchSide = 2 * kPatchRadius + 1;
/// Tiles are part of the result's definition: predictions are summed tile by tile.
constexpr int kTile = 32;
constexpr int kApron = kRadius + kPatchRadius;
constexpr int kBlock = kTile + 2 * kApron;
constexpr int kTerms = kTile + 2 * kPatchRadius;
constexpr float kLeastVariance = 1e-7f;
constexpr float kMostTerm = 1e4f;
/// Over the sum of weights; features have variance about 1. The published program has a rank-revealing
/// factorisation in its place. At 256x192, 1e-4 has 4 % more error in the Cornell box, and 1e-9 has 6 %; the
/// meeting room differs by 1 %.
constexpr double kRidge = 1e-5;
constexpr size_t kFixedColumns = 3;  // 1, dx, dy
constexpr size_t kMostColumns = kFixedColumns + kMostRegressionFeatures;

/// A tile with its apron, clamped at the picture's edge.
class Block {
 public:
  Block(const Plane& plane, int tile_x, int tile_y) {
    for (int y = 0; y < kBlock; ++y) {
      const float* row = plane.Row(std::clamp(tile_y + y - kApron, 0, plane.height() - 1));
      for (int x = 0; x < kBlock; ++x)
        values_[y][x] = row[std::clamp(tile_x + x - kApron, 0, plane.width() - 1)];
    }
  }
  const float* Row(int y) const { return values_[y]; }

 private:
  float values_[kBlock][kBlock];
};

using Blocks = std::vector<Block>;

Blocks MakeBlocks(const Planes& planes, int tile_x, int tile_y) {
  Blocks blocks;
  blocks.reserve(planes.size());
  for (const Plane& plane : planes) blocks.emplace_back(plane, tile_x, tile_y);
  return blocks;
}

/// The weights of the neighbours of all pixels of a tile.
class TileWeights {
 public:
  TileWeights(const Blocks& guide, const Blocks& variance, float strength)
      : weights_(static_cast<size_t>(kTile) * kTile * kPaddedOffsets) {
    int number = 0;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        Compare(guide, variance, strength * strength, dx, dy);
        SumPatches(number++);
      }
    }
  }

  /// The weights for pixel (x, y) of the tile, by offset, row by row.
  float* Of(int x, int y) { return weights_.data() + static_cast<size_t>(y * kTile + x) * kPaddedOffsets; }

 private:
  void Compare(const Blocks& guide, const Blocks& variance, float k2, int dx, int dy) {
    for (int y = 0; y < kTerms; ++y) {
      float* __restrict term = terms_[y];
      for (int x = 0; x < kTerms; ++x) term[x] = 0;
      for (size_t c = 0; c < 3; ++c) {
        const float* __restrict u = guide[c].Row(y + kRadius) + kRadius;
        const float* __restrict other = guide[c].Row(y + kRadius + dy) + kRadius + dx;
        const float* __restrict v = variance[c].Row(y + kRadius) + kRadius;
        const float* __restrict other_v = variance[c].Row(y + kRadius + dy) + kRadius + dx;
        for (int x = 0; x < kTerms; ++x) {
          const float difference = u[x] - other[x];
          const float noise = v[x] + (v[x] < other_v[x] ? v[x] : other_v[x]);
          const float excess =
              (difference * difference - noise) / (kLeastVariance + k2 * (v[x] + other_v[x]));
          term[x] += excess < kMostTerm ? excess : kMostTerm;
        }
      }
    }
  }

  void SumPatches(int number) {
    for (int y = 0; y < kTerms; ++y) {
      float* __restrict sum = row_sums_[y];
      const float* __restrict term = terms_[y];
      for (int x = 0; x < kTile; ++x) sum[x] = term[x];
      for (int i = 1; i < kPatchSide; ++i) {
        for (int x = 0; x < kTile; ++x) sum[x] += term[x + i];
      }
    }
    constexpr float kNorm = 1.0f / (3 * kPatchSide * kPatchSide);
    for (int y = 0; y < kTile; ++y) {
      alignas(64) float mean[kTile];
      for (int x = 0; x < kTile; ++x) mean[x] = row_sums_[y][x];
      for (int i = 1; i < kPatchSide; ++i) {
        for (int x = 0; x < kTile; ++x) mean[x] += row_sums_[y + i][x];
      }
      for (int x = 0; x < kTile; ++x) mean[x] = Exp(mean[x] > 0 ? -kNorm * mean[x] : 0.0f);
      for (int x = 0; x < kTile; ++x) Of(x, y)[number] = mean[x];
    }
  }

  std::vector<float> weights_;
  alignas(64) float terms_[kTerms][kTerms + 2];
  alignas(64) float row_sums_[kTerms][kTile];
};

/// The least-squares fit of one window at a time.
class WindowFit {
 public:
  explicit WindowFit(size_t features) : columns_(kFixedColumns + features) {
    for (int k = 0; k < kOffsets; ++k) {
      const int dx = k % kSide - kRadius;
      const int dy = k / kSide - kRadius;
      x_(k, 0) = 1;
      x_(k, 1) = static_cast<float>(dx) / kRadius;
      x_(k, 2) = static_cast<float>(dy) / kRadius;
    }
  }

  /// Fits the window around pixel (x, y) of a tile.
  void Fit(const Blocks& image, const Blocks& features, const float* weights, int x, int y) {
    weights_ = Eigen::Map<const Column>(weights);
    for (size_t f = 0; f < features.size(); ++f) {
      Load(features[f], x, y, x_.col(static_cast<Eigen::Index>(kFixedColumns + f)).data());
      const float center = features[f].Row(y + kApron)[x + kApron];
      x_.col(static_cast<Eigen::Index>(kFixedColumns + f)).array() -= center;
    }
    for (size_t c = 0; c < 3; ++c) Load(image[c], x, y, y_.col(static_cast<Eigen::Index>(c)).data());
    Solve();
  }

  /// The prediction for the neighbour at each offset, times its weight.
  const float* Predict(size_t channel) {
    predicted_.setZero();
    for (size_t i = 0; i < columns_; ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      predicted_ +=
          static_cast<float>(coefficients_(column, static_cast<Eigen::Index>(channel))) * x_.col(column);
    }
    predicted_.array() *= weights_.array();
    return predicted_.data();
  }

 private:
  using Column = Eigen::Matrix<float, kPaddedOffsets, 1>;
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostColumns, kMostColumns>;

  static void Load(const Block& block, int x, int y, float* column) {
    for (int j = 0; j < kSide; ++j)
      std::copy_n(block.Row(y + kPatchRadius + j) + x + kPatchRadius, kSide, column + j * kSide);
  }

  void Solve() {
    const auto n = static_cast<Eigen::Index>(columns_);
    Matrix normal(n, n);
    Matrix right(n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      weighted_ = weights_.cwiseProduct(x_.col(i));
      for (Eigen::Index j = i; j < n; ++j)
        normal(i, j) = normal(j, i) = static_cast<double>(weighted_.dot(x_.col(j)));
      for (Eigen::Index c = 0; c < 3; ++c) right(i, c) = static_cast<double>(weighted_.dot(y_.col(c)));
    }
    for (Eigen::Index i = 1; i < n; ++i) normal(i, i) += kRidge * normal(0, 0);
    coefficients_ = Eigen::LDLT<Matrix>(normal).solve(right);
  }

  size_t columns_;
  Eigen::Matrix<float, kPaddedOffsets, kMostColumns> x_ =
      Eigen::Matrix<float, kPaddedOffsets, kMostColumns>::Zero();
  Eigen::Matrix<float, kPaddedOffsets, 3> y_ = Eigen::Matrix<float, kPaddedOffsets, 3>::Zero();
  Column weights_;
  Column weighted_;
  Column predicted_;
  Matrix coefficients_;
};

/// Sums of weighted predictions of one tile, for its pixels and those around it: three channels and the
/// weight.
struct TileSums {
  std::array<std::vector<float>, 4> sums;
};

constexpr int kReach = kTile + 2 * kRadius;

void Add(const float* values, int x, int y, std::vector<float>* sums) {
  for (int j = 0; j < kSide; ++j) {
    float* row = sums->data() + (y + j) * kReach + x;
    for (int i = 0; i < kSide; ++i) row[i] += values[j * kSide + i];
  }
}

/// Sets the weights of offsets outside the picture to 0.
void CutAtEdges(int x, int y, int width, int height, float* weights) {
  for (int k = 0; k < kOffsets; ++k) {
    const int qx = x + k % kSide - kRadius;
    const int qy = y + k / kSide - kRadius;
    if (qx < 0 || qy < 0 || qx >= width || qy >= height) weights[k] = 0;
  }
}

TileSums FitTile(const RegressionInput& input, int tile_x, int tile_y) {
  const int width = input.image[0].width();
  const int height = input.image[0].height();
  const Blocks image = MakeBlocks(input.image, tile_x, tile_y);
  const Blocks features = MakeBlocks(input.features, tile_x, tile_y);
  const auto weights = std::make_unique<TileWeights>(
      MakeBlocks(input.guide, tile_x, tile_y), MakeBlocks(input.variance, tile_x, tile_y), input.strength);
  const auto fit = std::make_unique<WindowFit>(input.features.size());
  TileSums tile;
  for (std::vector<float>& sums : tile.sums) sums.resize(static_cast<size_t>(kReach) * kReach);
  ForEachPixel(std::min(kTile, width - tile_x), std::min(kTile, height - tile_y), [&](int x, int y) {
    float* w = weights->Of(x, y);
    CutAtEdges(tile_x + x, tile_y + y, width, height, w);
    fit->Fit(image, features, w, x, y);
    for (size_t c = 0; c < 3; ++c) Add(fit->Predict(c), x, y, &tile.sums[c]);
    Add(w, x, y, &tile.sums[3]);
  });
  return tile;
}

void AddTile(const TileSums& tile, size_t plane, int tile_x, int tile_y, Plane* out) {
  for (int y = std::max(0, tile_y - kRadius); y < std::min(out->height(), tile_y + kTile + kRadius); ++y) {
    const float* row = tile.sums[plane].data() + (y - tile_y + kRadius) * kReach;
    for (int x = std::max(0, tile_x - kRadius); x < std::min(out->width(), tile_x + kTile + kRadius); ++x)
      out->At(x, y) += row[x - tile_x + kRadius];
  }
}

}  // namespace

Planes PatchRegression(const RegressionInput& input, TaskPool* pool) {
  LUMIFOLD_CHECK(input.features.size() <= kMostRegressionFeatures);
  const int width = input.image[0].width();
  const int height = input.image[0].height();
  const int across = (width + kTile - 1) / kTile;
  const int down = (height + kTile - 1) / kTile;
  std::vector<TileSums> tiles(static_cast<size_t>(across) * static_cast<size_t>(down));
  ParallelFor(pool, static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    const int number = static_cast<int>(i);
    tiles[static_cast<size_t>(i)] = FitTile(input, number % across * kTile, number / across * kTile);
  });
  Planes sums = MakePlanes(4, width, height);
  ParallelFor(pool, 4, [&](int64_t plane) {
    const auto p = static_cast<size_t>(plane);
    for (int i = 0; i < across * down; ++i)
      AddTile(tiles[static_cast<size_t>(i)], p, i % across * kTile, i / across * kTile, &sums[p]);
  });
  const Plane total = std::move(sums.back());
  sums.pop_back();
  for (Plane& plane : sums) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) plane.At(x, y) /= total.At(x, y);  // a pixel's own weight is 1
    }
  }
  return sums;
}

}  // namespace lumifold::filter
