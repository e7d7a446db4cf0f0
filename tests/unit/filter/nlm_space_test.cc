#include "filter/manifold/nlm_space.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

#include "tests/unit/filter/manifold_oracle.h"

namespace lumifold::filter {
namespace {

Plane Ones(int width, int height) {
  Plane plane(width, height);
  plane.Fill(1);
  return plane;
}

Planes NoisePicture(int width, int height, uint32_t seed) {
  std::mt19937 random(seed);
  Planes planes = MakePlanes(3, width, height);
  for (Plane& plane : planes) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) plane.At(x, y) = static_cast<float>(random()) * 0x1p-32f - 0.5f;
    }
  }
  return planes;
}

TEST(PatchBasis, HasOrthonormalAxesUnderANormalisedWindow) {
  const Planes picture = NoisePicture(61, 47, 1);
  PatchParams params;
  params.explained_variance = 1.0;
  const PatchBasis basis = FitPatchBasis(picture, Ones(61, 47).view(), params, nullptr);
  ASSERT_EQ(basis.dimensions, 6);
  const size_t taps = 3 * 49;
  ASSERT_EQ(basis.kernels.size(), 6 * taps);
  // The window at an offset, from its definition.
  double squares = 0;
  for (int dy = -3; dy <= 3; ++dy) {
    for (int dx = -3; dx <= 3; ++dx) squares += 3 * std::exp(-2.0 * (dx * dx + dy * dy) / 3.0);
  }
  for (size_t i = 0; i < 6; ++i) {
    for (size_t j = 0; j <= i; ++j) {
      double dot = 0;
      for (size_t t = 0; t < taps; ++t) {
        const int dx = static_cast<int>(t % 7) - 3;
        const int dy = static_cast<int>(t % 49 / 7) - 3;
        const double window = std::exp(-(dx * dx + dy * dy) / 3.0) / std::sqrt(squares);
        dot += static_cast<double>(basis.kernels[i * taps + t]) / window *
               static_cast<double>(basis.kernels[j * taps + t]) / window;
      }
      EXPECT_NEAR(dot, i == j ? 1.0 : 0.0, 1e-4);
    }
  }
}

TEST(PatchBasis, FindsTheDirectionInWhichThePictureVaries) {
  // Only green varies, slowly: one axis explains all, and it looks at green alone.
  Planes picture = MakePlanes(3, 96, 64);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 96; ++x) picture[1].At(x, y) = static_cast<float>(x) * 0.1f;
  }
  PatchParams params;
  params.least_dimensions = 1;
  const PatchBasis basis = FitPatchBasis(picture, Ones(96, 64).view(), params, nullptr);
  EXPECT_EQ(basis.dimensions, 1);
  for (size_t t = 0; t < 49; ++t) {
    EXPECT_NEAR(basis.kernels[t], 0.0f, 1e-6f);
    EXPECT_GE(basis.kernels[49 + t], 0.0f);
    EXPECT_NEAR(basis.kernels[98 + t], 0.0f, 1e-6f);
  }
}

TEST(PatchBasis, LooksOnlyAtPatchesOfValidPixels) {
  Planes picture = MakePlanes(3, 64, 64);
  Plane mask = Ones(64, 64);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      picture[0].At(x, y) = static_cast<float>(y);
      if (x >= 32) mask.At(x, y) = 0;
      if (x >= 36) picture[2].At(x, y) = 1000.0f * static_cast<float>((x * 7 + y * 3) % 5);
    }
  }
  PatchParams params;
  params.least_dimensions = 1;
  const PatchBasis basis = FitPatchBasis(picture, mask.view(), params, nullptr);
  for (size_t t = 98; t < 147; ++t) EXPECT_NEAR(basis.kernels[t], 0.0f, 1e-6f);
}

TEST(ProjectPatches, EqualsItsOracleForPicturesOfAnySize) {
  constexpr std::pair<int, int> kSizes[] = {{13, 11}, {37, 3}, {1, 9}, {5, 1}, {1, 1}, {64, 70}};
  for (const auto& [width, height] : kSizes) {
    for (const int radius : {1, 2, 3}) {
      SCOPED_TRACE(testing::Message() << width << " x " << height << ", radius " << radius);
      const Planes picture = NoisePicture(width, height, 2);
      const PatchBasis basis =
          FitPatchBasis(picture, Ones(width, height).view(), {.radius = radius}, nullptr);
      const Planes coordinates = ProjectPatches(picture, basis, nullptr);
      const Planes expected = ProjectPatchesOracle(picture, basis);
      ASSERT_EQ(coordinates.size(), expected.size());
      for (size_t k = 0; k < coordinates.size(); ++k) {
        for (int y = 0; y < height; ++y) {
          for (int x = 0; x < width; ++x) ASSERT_EQ(coordinates[k].At(x, y), expected[k].At(x, y));
        }
      }
    }
  }
}

TEST(ProjectPatches, WhiteNoiseMovesAPatchByNoMoreThanItsOwnVariance) {
  const Planes picture = NoisePicture(128, 128, 3);  // variance 1/12
  PatchParams params;
  params.explained_variance = 1.0;
  const PatchBasis basis = FitPatchBasis(picture, Ones(128, 128).view(), params, nullptr);
  const Planes coordinates = ProjectPatches(picture, basis, nullptr);
  double sum = 0;
  for (const Plane& plane : coordinates) {
    for (int y = 4; y < 124; ++y) {
      for (int x = 4; x < 124; ++x)
        sum += static_cast<double>(plane.At(x, y)) * static_cast<double>(plane.At(x, y));
    }
  }
  EXPECT_LT(sum / (120 * 120), 1.05 / 12);
}

}  // namespace
}  // namespace lumifold::filter
