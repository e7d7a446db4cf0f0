#include "filter/manifold/manifold_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "filter/layers/guide.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/manifold_tree.h"
#include "filter/opencl/manifold_run.h"
#include "is_finite.h"
#include "tests/support/shuffling_pool.h"
#include "tests/unit/filter/kernel_rows.h"
#include "tests/unit/filter/manifold_inputs.h"
#include "tests/unit/filter/manifold_oracle.h"

namespace lumifold::filter {
namespace {

Planes Filtered(const ManifoldInput& input, const ManifoldParams& params, TaskPool* pool = nullptr) {
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
    const ManifoldInput input = MakeManifoldInput(c.width, c.height, c.dimensions, c.has_holes, 11);
    ManifoldParams params;
    params.sigma_s = c.sigma_s;
    params.height = c.tree_height;
    for (const bool keeps_mass : {false, true}) {
      params.keeps_mass = keeps_mass;
      const ManifoldResult slow =
          ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, c.sigma_s, nullptr);
      EXPECT_EQ(WorstDifference(Filtered(input, params), slow.filtered), 0.0)
          << c.width << "x" << c.height << " H " << c.tree_height << (keeps_mass ? " keeps mass" : "");
    }
  }
}

/// All kernels at once: strips and rows of cells of any length, cells of any size.
TEST(ManifoldFilter, EqualsItsOracleAtAnyWidthOfRowsAndCellsOnEachInstructionSet) {
  struct Case {
    int cell, columns, rows;
  };
  std::vector<Case> cases;
  for (const int cell : {1, 2, 4, 8, 16, 32, 64}) {
    for (const int columns : {1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 65, 257}) {
      if (columns * cell <= 1100) cases.push_back({cell, columns, 2});  // more than a strip
    }
  }
  for (const int rows : {1, 15, 16, 37, 83}) cases.push_back({1, 6, rows});
  for (const Case& c : cases) {
    const ManifoldInput input =
        MakeManifoldInput(c.columns * c.cell - c.cell / 3, c.rows * c.cell - c.cell / 2, 3, true, 18);
    const ManifoldParams params = {
        .sigma_s = 8, .height = 3, .cell = c.cell, .is_first_order = c.columns % 2 == 1};
    SlicePoints points = MakePoints(input, 3, 1);
    AddSignals(3, &points);
    const ManifoldResult slow =
        ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, 8, &points);
    OnEachTarget([&] {
      const ManifoldResult fast = ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(),
                                                         params, 8, &points, nullptr);
      EXPECT_EQ(WorstDifference(fast.filtered, slow.filtered), 0.0)
          << c.cell << ": " << c.columns << " x " << c.rows;
      EXPECT_EQ(fast.points.values, slow.points.values) << c.cell << ": " << c.columns << " x " << c.rows;
    });
  }
}

TEST(ManifoldFilter, PixelsFarFromAllManifoldsCountAsMuchAsOthersIfTheyKeepTheirMass) {
  constexpr int kSize = 32;
  ManifoldInput input = MakeManifoldInput(kSize, kSize, 1, false, 5);
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
  const ManifoldInput input = MakeManifoldInput(67, 45, 5, true, 12);
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
      EXPECT_EQ(WorstDifference(fast.filtered, slow.filtered), 0.0) << cell << " " << reach;
    }
  }
}

double WorstDifference(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i])));
  return worst;
}

TEST(ManifoldFilter, SlicesPointsBetweenPixelsAsItsOracleDoes) {
  const ManifoldInput input = MakeManifoldInput(75, 50, 7, true, 13);
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
    EXPECT_EQ(WorstDifference(fast.points.values, slow.points.values), 0.0) << reach;
    EXPECT_EQ(WorstDifference(fast.points.weights, slow.points.weights), 0.0) << reach;
  }
}

TEST(ManifoldFilter, SplatsPointsWithSignalsAsItsOracleDoes) {
  const ManifoldInput input = MakeManifoldInput(75, 50, 7, true, 17);
  for (const size_t samples : {size_t{1}, size_t{3}}) {
    SlicePoints points = MakePoints(input, samples, 4);
    points.pixels.push_back(points.pixels.front());  // in any order
    const std::vector<float> repeated(points.features.end() - 4, points.features.end());
    points.features.insert(points.features.end(), repeated.begin(), repeated.end());
    const Planes before = Filtered(input, {.height = 3});
    AddSignals(3, &points);
    for (const auto& [reach, keeps_mass] : {std::pair{16.0f, false}, {5.0f, false}, {16.0f, true}}) {
      const ManifoldParams params = {.height = 3, .keeps_mass = keeps_mass};
      const ManifoldResult fast = ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(),
                                                         params, reach, &points, nullptr);
      const ManifoldResult slow =
          ManifoldFilterOracle(input.signals, input.features, input.mask.view(), params, reach, &points);
      EXPECT_EQ(WorstDifference(fast.filtered, slow.filtered), 0.0) << samples << " " << reach;
      EXPECT_EQ(WorstDifference(fast.points.values, slow.points.values), 0.0) << samples << " " << reach;
      EXPECT_EQ(WorstDifference(fast.points.weights, slow.points.weights), 0.0) << samples << " " << reach;
      EXPECT_GT(WorstDifference(fast.filtered, before), 0.01) << "points count in the result of pixels";
    }
  }
}

TEST(ManifoldFilter, IsTheSameInAnyMemoryOfADevice) {
  const ManifoldInput input = MakeManifoldInput(61, 43, 5, true, 19);
  SlicePoints points = MakePoints(input, 2, 2);
  AddSignals(3, &points);
  for (const bool fits : {false, true}) {
    for (const int height : {1, 2, 4}) {
      const ManifoldParams params = {
          .sigma_s = 7, .height = height, .cell = 4, .keeps_mass = true, .is_first_order = fits};
      const ManifoldCall call = {
          ViewsOf(input.signals), {}, ViewsOf(input.features), input.mask.view(), params, 16, &points};
      const DeviceMemory least = LeastMemory(call);
      const auto run = [&](const DeviceMemory& memory) { return FilterOracle(call, memory); };
      const ManifoldResult whole = run({});
      for (const uint64_t percent : {100, 115, 140, 200}) {
        const ManifoldResult small = run({least.whole * percent / 100, least.largest * percent / 100});
        EXPECT_EQ(WorstDifference(whole.filtered, small.filtered), 0.0) << height << " " << percent;
        EXPECT_EQ(whole.points.values, small.points.values);
        EXPECT_EQ(whole.points.weights, small.points.weights);
      }
    }
  }
}

TEST(FilterGuided, EqualsItsOracleForBasesAndStabilisedGuides) {
  const ManifoldInput input = MakeManifoldInput(37, 29, 2, true, 16);
  const ManifoldInput base = MakeManifoldInput(37, 29, 2, false, 17);
  Halves halves;
  halves.level = 0.7f;
  halves.share_a = MakePlane(37, 29, 0.5f);
  halves.weight = MakePlane(37, 29, 1.0f);
  for (const float knee : {0.02f, 2.0f}) {
    const JointGuides guides = MakeJointGuides(MakeGuide(halves, input.signals, base.signals, knee, nullptr),
                                               halves, {.radius = 1}, 0.5f, input.features, nullptr);
    const std::vector<GuidedFiltering> filterings = {
        {input.signals, &base.signals, guides.b, 1, input.mask.view(), nullptr},
        {base.signals, &input.signals, guides.a, 0.7f, input.mask.view(), nullptr}};
    const auto run = [&](TaskPool* pool) { return FilterGuided(filterings, {.height = 3}, 16, pool); };
    const std::vector<ManifoldResult> here = run(nullptr);
    for (const bool is_small : {false, true}) {
      const std::vector<ManifoldResult> oracle = run(PoolWithOracle(is_small).get());
      for (const size_t i : {0, 1}) EXPECT_EQ(WorstDifference(here[i].filtered, oracle[i].filtered), 0.0);
    }
  }
}

TEST(ManifoldFilter, FindsNothingForAPointFarFromAllManifolds) {
  const ManifoldInput input = MakeManifoldInput(40, 40, 5, false, 14);
  const SlicePoints points = MakePoints(input, 4, 3);
  const ManifoldResult result =
      ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(), {}, 16, &points, nullptr);
  size_t lost = 0;
  for (size_t i = 1; i < points.pixels.size(); i += 4) {
    const auto [x, y] = points.pixels[i];
    if ((x + y) % 5 != 0) continue;
    ++lost;
    EXPECT_EQ(result.points.weights[i], 0.0f);
    for (size_t c = 0; c < 3; ++c) EXPECT_EQ(result.points.values[3 * i + c], 0.0f);
    EXPECT_GT(result.points.weights[i + 1], 0.0f);
  }
  EXPECT_GT(lost, 10u);
}

TEST(ManifoldFilter, GivesPointsTheSameBitsForAnyPool) {
  const ManifoldInput input = MakeManifoldInput(90, 70, 6, true, 15);
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

TEST(ManifoldFilter, GivesTheSameBitsForAnyPool) {
  const ManifoldInput input = MakeManifoldInput(150, 201, 6, true, 3);
  const Planes alone = Filtered(input, {});
  std::vector<std::unique_ptr<TaskPool>> pools;
  for (const int threads : {1, 2, 4}) pools.push_back(MakeTaskPool(threads));
  for (const uint32_t seed : {1u, 2u, 3u}) pools.push_back(std::make_unique<ShufflingPool>(seed));
  for (const auto& pool : pools) EXPECT_EQ(WorstDifference(Filtered(input, {}, pool.get()), alone), 0.0);
}

TEST(ManifoldFilter, KeepsAConstantSignal) {
  ManifoldInput input = MakeManifoldInput(70, 50, 5, true, 4);
  for (Plane& signal : input.signals) signal.Fill(0.75f);
  for (const Plane& plane : Filtered(input, {})) {
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 70; ++x) ASSERT_NEAR(plane.At(x, y), 0.75f, 2e-6f);
    }
  }
}

TEST(ManifoldFilter, TakesNothingFromMaskedPixels) {
  ManifoldInput input = MakeManifoldInput(60, 48, 4, true, 5);
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
    ManifoldInput input = MakeManifoldInput(64, 40, 2, false, 6);
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
  ManifoldInput input = MakeManifoldInput(33, 21, 3, false, 7);
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
  ManifoldInput input = MakeManifoldInput(kWidth, 64, 2, true, 8);
  // Slopes, no steps and no holes: where the guide's slope changes, the recursion's two directions are not
  // quite alike.
  input.mask.Fill(1);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      input.features[0].At(x, y) = 0.05f * static_cast<float>(x);
      input.features[1].At(x, y) = 0.03f * static_cast<float>(y);
    }
  }
  ManifoldInput mirrored{{}, {}, Mirrored(input.mask)};
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
  ManifoldInput input{MakePlanes(1, kSize, kSize), MakePlanes(1, kSize, kSize), Plane(kSize, kSize)};
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
