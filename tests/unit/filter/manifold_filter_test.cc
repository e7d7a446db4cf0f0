#include "filter/manifold/manifold_filter.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "filter/manifold/manifold_tree.h"
#include "is_finite.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/manifold_oracle.h"

namespace lumifold::filter {
namespace {

struct Input {
  Planes signals;
  Planes features;
  Plane mask;
};

/// Smooth regions with edges, noise on both signals and features, and a mask with holes.
Input MakeInput(int width, int height, size_t dimensions, bool has_holes, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0f, 1.0f);
  Input input{MakePlanes(3, width, height), MakePlanes(dimensions, width, height), Plane(width, height)};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int region = (x > width / 2 ? 1 : 0) + (2 * y > x ? 2 : 0);
      for (size_t k = 0; k < dimensions; ++k) {
        const float level = static_cast<float>((region * (static_cast<int>(k) + 3)) % 5);
        input.features[k].At(x, y) = 1.3f * level + 0.02f * static_cast<float>(x) + 0.3f * normal(random);
      }
      for (Plane& signal : input.signals)
        signal.At(x, y) = static_cast<float>(region) + 0.5f * normal(random);
      input.mask.At(x, y) = has_holes && (x * 7 + y * 13) % 11 < 3 ? 0.0f : 1.0f;
    }
  }
  return input;
}

Planes Filtered(const Input& input, const ManifoldParams& params, TaskPool* pool = nullptr) {
  return ManifoldFilter(input.signals, input.features, input.mask.view(), params, pool);
}

double WorstDifference(const Planes& a, const Planes& b) {
  double worst = 0;
  for (size_t c = 0; c < a.size(); ++c) {
    for (int y = 0; y < a[c].height(); ++y) {
      for (int x = 0; x < a[c].width(); ++x) {
        const double difference =
            std::abs(static_cast<double>(a[c].At(x, y)) - static_cast<double>(b[c].At(x, y)));
        worst = difference <= worst ? worst : difference;
      }
    }
  }
  return worst;
}

TEST(ManifoldFilter, EqualsItsOracleForOddSizesMasksReachesAndHeights) {
  struct Case {
    int width, height;
    size_t dimensions;
    bool has_holes;
    float sigma_s;
    int tree_height;
  };
  const Case cases[] = {{37, 29, 4, false, 16, 2}, {37, 29, 4, true, 16, 3}, {65, 33, 7, true, 8, 4},
                        {30, 70, 10, true, 16, 5}, {19, 23, 3, true, 4, 4},  {1, 17, 2, false, 8, 3},
                        {23, 1, 5, true, 32, 4},   {1, 1, 4, false, 16, 4}};
  for (const Case& c : cases) {
    const Input input = MakeInput(c.width, c.height, c.dimensions, c.has_holes, 11);
    ManifoldParams params;
    params.sigma_s = c.sigma_s;
    params.height = c.tree_height;
    for (const bool keeps_mass : {false, true}) {
      params.keeps_mass = keeps_mass;
      const ManifoldResult slow =
          ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, c.sigma_s, nullptr);
      EXPECT_LT(WorstDifference(Filtered(input, params), slow.filtered), 2e-5)
          << c.width << "x" << c.height << " H " << c.tree_height << (keeps_mass ? " keeps mass" : "");
    }
  }
}

TEST(ManifoldFilter, PixelsFarFromAllManifoldsCountAsMuchAsOthersIfTheyKeepTheirMass) {
  constexpr int kSize = 32;
  Input input = MakeInput(kSize, kSize, 1, false, 5);
  double mean = 0;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const bool is_far =
          (x + y) % 2 == 0 && x % 4 == 0;  // an eighth of them: the one manifold runs at 0.375
      input.features[0].At(x, y) = is_far ? 3.0f : 0.0f;
      for (Plane& signal : input.signals) signal.At(x, y) = is_far ? 1.0f : 0.0f;
      mean += is_far ? 1.0 / (kSize * kSize) : 0.0;
    }
  }
  ManifoldParams params = {.sigma_s = 1e6f, .height = 1, .cell = 4};
  EXPECT_LT(Filtered(input, params)[0].At(9, 9), 0.1 * mean);
  params.keeps_mass = true;
  EXPECT_NEAR(Filtered(input, params)[0].At(9, 9), mean, 1e-3);
}

TEST(ManifoldFilter, EqualsItsOracleAtAReachAndCellsOfItsOwn) {
  const Input input = MakeInput(67, 45, 5, true, 12);
  ManifoldParams params;
  params.sigma_s = 8;
  params.height = 3;
  for (const int cell : {1, 2, 4, 16}) {
    params.cell = cell;
    for (const float reach : {12.0f, 3.0f, 24.0f}) {
      const ManifoldResult fast = ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(),
                                                         params, reach, nullptr, nullptr);
      const ManifoldResult slow =
          ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, reach, nullptr);
      EXPECT_TRUE(fast.points.values.empty());
      EXPECT_LT(WorstDifference(fast.filtered, slow.filtered), 3e-5) << cell << " " << reach;
    }
  }
}

/// Points in every seventh pixel, near its own features or far from them all.
SlicePoints MakePoints(const Input& input, size_t samples, size_t own_features) {
  std::mt19937 random(21);
  std::normal_distribution<float> normal(0.0f, 0.7f);
  SlicePoints points;
  points.samples = samples;
  points.own_features = own_features;
  const size_t shared = input.features.size() - own_features;
  for (int y = 0; y < input.mask.height(); ++y) {
    for (int x = y % 7; x < input.mask.width(); x += 7) {
      points.pixels.push_back({x, y});
      for (size_t k = 0; k < own_features; ++k) {
        for (size_t j = 0; j < samples; ++j) {
          const float far = (x + y) % 5 == 0 && j == 1 ? 300.0f : 0.0f;
          points.features.push_back(input.features[shared + k].At(x, y) + far + normal(random));
        }
      }
    }
  }
  return points;
}

double WorstDifference(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i])));
  return worst;
}

TEST(ManifoldFilter, SlicesPointsBetweenPixelsAsItsOracleDoes) {
  const Input input = MakeInput(75, 50, 7, true, 13);
  const SlicePoints points = MakePoints(input, 16, 4);
  ManifoldParams params;
  params.height = 3;
  for (const float reach : {params.sigma_s, 3.0f}) {
    const ManifoldResult fast = ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(),
                                                       params, reach, &points, nullptr);
    const ManifoldResult slow =
        ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, reach, &points);
    EXPECT_EQ(WorstDifference(fast.filtered, Filtered(input, params)) == 0,
              reach == params.sigma_s);  // points change nothing
    EXPECT_LT(WorstDifference(fast.points.values, slow.points.values), 1e-4) << reach;
    EXPECT_LT(WorstDifference(fast.points.weights, slow.points.weights), 1e-4) << reach;
  }
}

/// Gives points signals of their own, and weights of which some are 0.
void AddSignals(size_t channels, SlicePoints* points) {
  std::mt19937 random(22);
  std::normal_distribution<float> normal(2.0f, 0.5f);
  const size_t count = points->pixels.size() * points->samples;
  for (size_t i = 0; i < count * channels; ++i) points->signals.push_back(normal(random));
  for (size_t i = 0; i < count; ++i) points->weights.push_back(static_cast<float>(i % 3) * 0.5f);
}

TEST(ManifoldFilter, SplatsPointsWithSignalsAsItsOracleDoes) {
  const Input input = MakeInput(75, 50, 7, true, 17);
  for (const size_t samples : {size_t{1}, size_t{3}}) {
    SlicePoints points = MakePoints(input, samples, 4);
    points.pixels.push_back(points.pixels.back());  // a pixel may occur repeatedly
    const auto last = static_cast<std::ptrdiff_t>(4 * samples);
    const std::vector<float> repeated(points.features.end() - last, points.features.end());
    points.features.insert(points.features.end(), repeated.begin(), repeated.end());
    const Planes before = Filtered(input, {.height = 3});
    AddSignals(3, &points);
    for (const auto& [reach, keeps_mass] : {std::pair{16.0f, false}, {5.0f, false}, {16.0f, true}}) {
      const ManifoldParams params = {.height = 3, .keeps_mass = keeps_mass};
      const ManifoldResult fast = ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(),
                                                         params, reach, &points, nullptr);
      const ManifoldResult slow =
          ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, reach, &points);
      EXPECT_LT(WorstDifference(fast.filtered, slow.filtered), 1e-4) << samples << " " << reach;
      EXPECT_LT(WorstDifference(fast.points.values, slow.points.values), 1e-4) << samples << " " << reach;
      EXPECT_LT(WorstDifference(fast.points.weights, slow.points.weights), 1e-4) << samples << " " << reach;
      EXPECT_GT(WorstDifference(fast.filtered, before), 0.01) << "points count in the result of pixels";
    }
  }
}

TEST(ManifoldFilter, FindsNothingForAPointFarFromAllManifolds) {
  const Input input = MakeInput(40, 40, 5, false, 14);
  const SlicePoints points = MakePoints(input, 4, 3);
  const ManifoldResult result =
      ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(), {}, 16, &points, nullptr);
  size_t lost = 0;
  for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
    const auto [x, y] = points.pixels[pixel];
    if ((x + y) % 5 != 0) continue;
    ++lost;
    EXPECT_EQ(result.points.weights[pixel * 4 + 1], 0.0f);
    for (size_t c = 0; c < 3; ++c) EXPECT_EQ(result.points.values[(pixel * 3 + c) * 4 + 1], 0.0f);
    EXPECT_GT(result.points.weights[pixel * 4 + 2], 0.0f);
  }
  EXPECT_GT(lost, 10u);
}

TEST(ManifoldFilter, GivesPointsTheSameBitsForAnyPool) {
  const Input input = MakeInput(90, 70, 6, true, 15);
  SlicePoints points = MakePoints(input, 16, 4);
  AddSignals(3, &points);
  ShufflingPool pool(9);
  const auto run = [&](TaskPool* with) {
    return ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(), {}, 16, &points, with);
  };
  const ManifoldResult alone = run(nullptr);
  const ManifoldResult shuffled = run(&pool);
  EXPECT_EQ(alone.points.values, shuffled.points.values);
  EXPECT_EQ(alone.points.weights, shuffled.points.weights);
}

TEST(ManifoldFilter, GivesTheSameBitsOnEachInstructionSet) {
  const Input input = MakeInput(301, 70, 6, true, 16);
  const Planes widest = Filtered(input, {});
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    EXPECT_EQ(WorstDifference(Filtered(input, {}), widest), 0.0) << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
}

TEST(ManifoldFilter, GivesTheSameBitsForAnyPool) {
  const Input input = MakeInput(150, 201, 6, true, 3);
  const Planes alone = Filtered(input, {});
  std::vector<std::unique_ptr<TaskPool>> pools;
  for (const int threads : {1, 2, 4}) pools.push_back(MakeTaskPool(threads));
  for (const uint32_t seed : {1u, 2u, 3u}) pools.push_back(std::make_unique<ShufflingPool>(seed));
  for (const auto& pool : pools) EXPECT_EQ(WorstDifference(Filtered(input, {}, pool.get()), alone), 0.0);
}

TEST(ManifoldFilter, KeepsAConstantSignal) {
  Input input = MakeInput(70, 50, 5, true, 4);
  for (Plane& signal : input.signals) signal.Fill(0.75f);
  for (const Plane& plane : Filtered(input, {})) {
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 70; ++x) ASSERT_NEAR(plane.At(x, y), 0.75f, 2e-6f);
    }
  }
}

TEST(ManifoldFilter, TakesNothingFromMaskedPixels) {
  Input input = MakeInput(60, 48, 4, true, 5);
  const Planes before = Filtered(input, {});
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 60; ++x) {
      if (input.mask.At(x, y) > 0) continue;
      for (Plane& signal : input.signals) signal.At(x, y) = 1e6f;
      for (Plane& feature : input.features) feature.At(x, y) = -50.0f;
    }
  }
  const Planes after = Filtered(input, {});
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 60; ++x) {
      if (input.mask.At(x, y) == 0) continue;
      ASSERT_EQ(after[1].At(x, y), before[1].At(x, y));
    }
  }
}

TEST(ManifoldFilter, StaysFiniteWithEmptyClustersAndFarFeatures) {
  // Two values of u: from the second level on, some clusters are empty, and each side is infinitely far from
  // the other.
  for (const float distance : {0.5f, 5.0f, 1e4f}) {
    Input input = MakeInput(64, 40, 2, false, 6);
    for (Plane& feature : input.features) {
      for (int y = 0; y < 40; ++y) {
        for (int x = 0; x < 64; ++x) feature.At(x, y) = x < 20 ? 0.0f : distance;
      }
    }
    ManifoldParams params;
    params.height = 5;
    EXPECT_TRUE(IsFinite(Filtered(input, params))) << distance;
  }
}

TEST(ManifoldFilter, LeavesThePictureAloneWhenNoPixelIsValid) {
  Input input = MakeInput(33, 21, 3, false, 7);
  input.mask.Fill(0);
  EXPECT_EQ(WorstDifference(Filtered(input, {}), input.signals), 0.0);
}

Plane Mirrored(const Plane& plane) {
  Plane mirrored(plane.width(), plane.height());
  for (int y = 0; y < plane.height(); ++y) {
    for (int x = 0; x < plane.width(); ++x) mirrored.At(x, y) = plane.At(plane.width() - 1 - x, y);
  }
  return mirrored;
}

TEST(ManifoldFilter, MirrorsWithItsInputAwayFromTheEdges) {
  constexpr int kWidth = 320;  // whole cells, so that the mirror image has the same cells
  Input input = MakeInput(kWidth, 64, 2, true, 8);
  // Slopes, no steps and no holes: where the guide's slope changes, the recursion's two directions are not
  // quite alike.
  input.mask.Fill(1);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      input.features[0].At(x, y) = 0.05f * static_cast<float>(x);
      input.features[1].At(x, y) = 0.03f * static_cast<float>(y);
    }
  }
  Input mirrored{{}, {}, Mirrored(input.mask)};
  for (const Plane& plane : input.signals) mirrored.signals.push_back(Mirrored(plane));
  for (const Plane& plane : input.features) mirrored.features.push_back(Mirrored(plane));
  ManifoldParams params;
  params.sigma_s = 8;
  params.height = 1;  // the axes that split clusters see the whole picture, edges too
  const Planes plain = Filtered(input, params);
  const Planes reflected = Filtered(mirrored, params);
  for (int y = 0; y < 64; ++y) {
    for (int x = 96; x < kWidth - 96; ++x) {
      ASSERT_NEAR(plain[0].At(x, y), reflected[0].At(kWidth - 1 - x, y), 1e-4f) << x << "," << y;
    }
  }
}

TEST(ManifoldFilter, AveragesNoiseAndKeepsAnEdgeOfTheFeatures) {
  constexpr int kSize = 96;
  Input input{MakePlanes(1, kSize, kSize), MakePlanes(1, kSize, kSize), Plane(kSize, kSize)};
  input.mask.Fill(1);
  std::mt19937 random(9);
  std::normal_distribution<float> noise(0.0f, 0.5f);
  double noisy = 0;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const float truth = x < kSize / 2 ? 1.0f : 3.0f;
      const float error = noise(random);
      noisy += static_cast<double>(error) * static_cast<double>(error);
      input.signals[0].At(x, y) = truth + error;
      input.features[0].At(x, y) = x < kSize / 2 ? 0.0f : 5.0f;
    }
  }
  const Planes result = Filtered(input, {});
  double filtered = 0;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const double error = static_cast<double>(result[0].At(x, y)) - (x < kSize / 2 ? 1.0 : 3.0);
      filtered += error * error;
    }
  }
  EXPECT_LT(filtered, 0.02 * noisy);
}

/// Sums of a cluster whose cells spread mostly along (1, 1, 1).
ClusterSums SpreadAlongADiagonal() {
  const Lattice lattice(64, 64, 4);
  ClusterSums sums = MakeClusterSums(3, lattice);
  sums.weight.Fill(1);
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x) {
      const float along = (x + y) % 2 == 0 ? 1.0f : -1.0f;
      const float across = x % 2 == 0 ? 0.7f : -0.7f;
      sums.weighted[0].At(x, y) = along + across;
      sums.weighted[1].At(x, y) = along - across;
      sums.weighted[2].At(x, y) = along;
    }
  }
  return sums;
}

TEST(ManifoldTree, FeedsThePowerIterationBack) {  // each step must turn the axis further towards the spread
  float previous = 0;
  for (const int iterations : {1, 2, 3, 6}) {
    const Manifold manifold = MakeManifold(SpreadAlongADiagonal(), nullptr, 4.0f, iterations, nullptr);
    const float aligned = std::abs(manifold.axis[0] + manifold.axis[1] + manifold.axis[2]) / std::sqrt(3.0f);
    EXPECT_GT(aligned, previous) << iterations;
    previous = aligned;
  }
  EXPECT_GT(previous, 0.99f);
}

TEST(CellSize, IsAPowerOfTwoUpToAQuarterOfTheReach) {
  EXPECT_EQ(CellSize(0.5f), 1);
  EXPECT_EQ(CellSize(4.0f), 2);
  EXPECT_EQ(CellSize(15.9f), 2);
  EXPECT_EQ(CellSize(16.0f), 4);
  EXPECT_EQ(CellSize(2048.0f), 64);
}

}  // namespace
}  // namespace lumifold::filter
