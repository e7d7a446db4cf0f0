#include "filter/manifold/recursive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "filter/manifold/lattice.h"
#include "filter/manifold/sites.h"

namespace lumifold::filter {
namespace {

TEST(LowPass, AnswersAnImpulseSymmetricallyAwayFromTheEdges) {
  Plane plane(129, 129);
  plane.At(64, 64) = 1;
  LowPass(3.0f, &plane);
  const float peak = plane.At(64, 64);
  for (int offset = 1; offset < 12; ++offset) {
    EXPECT_NEAR(plane.At(64 - offset, 64), plane.At(64 + offset, 64), 1e-6f * peak) << offset;
    EXPECT_NEAR(plane.At(64, 64 - offset), plane.At(64, 64 + offset), 1e-6f * peak) << offset;
    EXPECT_LT(plane.At(64 + offset, 64), plane.At(63 + offset, 64));
  }
}

TEST(LowPass, KeepsConstantsAndTheSumOfAnInnerImpulse) {
  Plane constant(17, 9);
  constant.Fill(2.5f);
  LowPass(4.0f, &constant);
  EXPECT_NEAR(constant.At(3, 4), 2.5f, 1e-5f);

  Plane impulse(201, 201);
  impulse.At(100, 100) = 1;
  LowPass(4.0f, &impulse);
  double sum = 0;
  for (int y = 0; y < 201; ++y) {
    for (int x = 0; x < 201; ++x) sum += static_cast<double>(impulse.At(x, y));
  }
  EXPECT_NEAR(sum, 1.0, 1e-4);
}

TEST(GuidedLowPass, EqualsLowPassWhereTheGuideIsFlat) {
  Planes guide = MakePlanes(2, 40, 30);
  Planes signals = MakePlanes(5, 40, 30);
  for (size_t c = 0; c < signals.size(); ++c) signals[c].At(7 * static_cast<int>(c) + 3, 11) = 1;
  Plane expected = signals[2].Clone();
  LowPass(4.0f, &expected);
  const Planes blurred = GuidedLowPass(4.0f, 0.7f, guide, signals, nullptr);
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) EXPECT_NEAR(blurred[2].At(x, y), expected.At(x, y), 1e-7f);
  }
}

TEST(GuidedLowPass, StopsAtAStepOfTheGuide) {
  Planes guide = MakePlanes(1, 40, 8);
  Planes signals = MakePlanes(1, 40, 8);
  for (int y = 0; y < 8; ++y) {
    for (int x = 20; x < 40; ++x) guide[0].At(x, y) = 6;
    for (int x = 0; x < 20; ++x) signals[0].At(x, y) = 1;
  }
  signals = GuidedLowPass(4.0f, 0.7f, guide, signals, nullptr);
  EXPECT_GT(signals[0].At(19, 4), 0.99f);
  EXPECT_LT(signals[0].At(20, 4), 0.01f);
}

TEST(Lattice, CutsTheLastCells) {
  const Lattice lattice(10, 7, 4);
  EXPECT_EQ(lattice.Columns(), 3);
  EXPECT_EQ(lattice.Rows(), 2);
  EXPECT_EQ(lattice.ColumnWidth(2), 2);
  EXPECT_EQ(lattice.RowHeight(1), 3);
}

TEST(Sites, OrderRowsByPhaseAndBackAndPointsBelowThemByRow) {
  SlicePoints points;  // more of row 1 than fit a row of sites
  for (int i = 0; i < 200; ++i) points.pixels.push_back({i % 37, i % 2});
  for (const int step : {1, 2, 4}) {
    const Lattice lattice(37, 2, step);
    const Sites sites(lattice, &points);
    Plane plane(37, 2);
    for (int x = 0; x < 37; ++x) plane.At(x, 1) = static_cast<float>(x + 1);
    const auto number = [](size_t i) { return static_cast<float>(i + 1); };
    Plane of_sites = sites.PlaneOf(plane.view(), number, nullptr);
    float sum = 0;  // what no site has is 0
    for (int y = 0; y < sites.Rows(); ++y) {
      for (int i = 0; i < sites.Width(); ++i) sum += of_sites.At(i, y);
    }
    EXPECT_EQ(sum, 37 * 38 / 2 + 200 * 201 / 2) << step;
    for (int x = 0; x < 37; ++x) EXPECT_EQ(of_sites.At(lattice.Place(x), 1), plane.At(x, 1)) << step;
    const Plane back = InOrder(of_sites, lattice, nullptr);
    for (int x = 0; x < 37; ++x) EXPECT_EQ(back.At(x, 1), plane.At(x, 1)) << step;
    size_t next = 1;  // odd points are of row 1
    for (const PointRun& run : sites.RunsOf(1, 0)) {
      for (int i = 0; i < run.count; ++i, next += 2)
        EXPECT_EQ(of_sites.At(run.x + i, run.row), number(next)) << step;
    }
    EXPECT_EQ(next, 201u);
  }
}

TEST(SpanOf, LiesWhereThePixelIsBetweenCellCentres) {
  for (const int step : {1, 2, 4, 8, 16}) {
    const int cells = 64 / step;
    const auto centre_of = [&](int cell) {
      return (static_cast<float>(cell) + 0.5f) * static_cast<float>(step) - 0.5f;
    };
    for (int x = step; x < 64 - step; ++x) {
      const CellSpan span = SpanOf(x, step, cells);
      const float at = centre_of(span.first) + span.part * (centre_of(span.second) - centre_of(span.first));
      ASSERT_NEAR(at, static_cast<float>(x), 1e-4) << "cells of " << step;
    }
    EXPECT_EQ(SpanOf(0, step, cells).first, 0) << "cells of " << step;
    EXPECT_EQ(SpanOf(63, step, cells).second, cells - 1) << "cells of " << step;
  }
}

}  // namespace
}  // namespace lumifold::filter
