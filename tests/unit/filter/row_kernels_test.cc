#include "filter/kernels/row_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/portable_math.h"
#include "tests/unit/filter/kernel_rows.h"

namespace lumifold::filter {
namespace {

using RowKernels = KernelTest;

/// From one phase of a row to the next, where a row has at most so many pixels.
constexpr std::ptrdiff_t PhaseStride(int step) { return kStripColumns / step + kRowPadding; }

TEST_F(RowKernels, StabiliseRowEqualsAsinhAtAnyOffsetOnEachTarget) {
  const Row in = Random();
  OnEachTarget([&] {
    for (const int count : kCounts) {
      for (const size_t offset : {0u, 1u, 5u}) {
        Row fast(kRoom, 9.0f);
        Row slow(kRoom, 9.0f);
        StabiliseRow(in.data(), 7.5f, 0.25f, count, fast.data() + offset);
        for (size_t x = 0; x < static_cast<size_t>(count); ++x)
          slow[x + offset] = Asinh(in[x] * 7.5f) - 0.25f;
        ExpectSame(fast, slow, static_cast<int>(kRoom));
      }
    }
  });
}

TEST_F(RowKernels, CorrelateRowsEqualsItsOracleOnEachTarget) {
  std::vector<Row> pixels = RandomRows(6);
  const auto rows = Pointers<const float*>(pixels);
  const Row taps = Random(6 * 7);
  OnEachTarget([&] {
    for (const int row_taps : {1, 3, 5, 7}) {
      for (const int count : kCounts) {
        Row fast(kRoom, 9.0f);
        Row slow(kRoom, 9.0f);
        CorrelateRows({taps.data(), row_taps, rows.data(), rows.size(), count}, fast.data());
        CorrelateNarrowRows({taps.data(), row_taps, rows.data(), rows.size(), count}, slow.data());
        ExpectSame(fast, slow, static_cast<int>(kRoom));
      }
    }
  });
}

TEST(Phases, ReadALinearRampExactlyBetweenCellCentres) {
  for (const int step : kSteps) {
    Row cells(kRoom);
    for (size_t p = 0; p < cells.size(); ++p)  // cell p stands one before cell p - 1 of the strip
      cells[p] = (static_cast<float>(p) - 0.5f) * static_cast<float>(step) - 0.5f;
    Row ones(kPhasedRoom, 1.0f);
    Row sums(kPhasedRoom);
    const float* weights = ones.data();
    float* out = sums.data();
    SliceRow(Phases(step),
             {&weights, 1, cells.data(), kRoom, 1, &out, false, PhaseStride(step), kStripColumns / step});
    for (int x = 0; x < kStripColumns; ++x)
      ASSERT_NEAR(out[x % step * PhaseStride(step) + x / step], static_cast<float>(x), 1e-4f) << step;
  }
}

TEST(Asinh, IsNearTheLibrarysAndOdd) {
  constexpr int kSteps = 986;  // from 1e-12 to 1e17
  for (int step = 0; step < kSteps; ++step) {
    const double x = 1e-12 * std::pow(1.07, step);
    const float value = Asinh(static_cast<float>(x));
    const double expected = std::asinh(static_cast<double>(static_cast<float>(x)));
    EXPECT_NEAR(static_cast<double>(value), expected, 6e-7 * expected) << x;
    EXPECT_EQ(Asinh(-static_cast<float>(x)), -value);
  }
  EXPECT_EQ(Asinh(0.0f), 0.0f);
  EXPECT_TRUE(std::isfinite(Asinh(3e38f)));
}

}  // namespace
}  // namespace lumifold::filter
