#include "filter/kernels/row_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "filter/image/portable_math.h"
#include "tests/unit/filter/kernel_oracles.h"
#include "tests/unit/filter/kernel_rows.h"

namespace lumifold::filter {
namespace {

using RowKernels = KernelTest;

struct WeighCase {
  std::vector<Row> features, near_sums, far_sums;
  Row eta, weight, total, axis, labels, members, next_labels;
};

/// From one phase of a row to the next, where a row has at most so many pixels.
constexpr std::ptrdiff_t PhaseStride(int step) { return kStripColumns / step + kRowPadding; }

bool RunWeigh(bool (*kernel)(const Phases&, const WeighArgs&, const SplitArgs*), int step, int count,
              bool splits, WeighCase* c) {
  const auto features = Pointers<const float*>(c->features);
  const auto near_sums = Pointers<float*>(c->near_sums);
  const auto far_sums = Pointers<float*>(c->far_sums);
  const WeighArgs args = {features.data(), c->eta.data(),     kRoom, features.size(), c->weight.data(),
                          c->total.data(), PhaseStride(step), count};
  const SplitArgs split = {c->axis.data(),        2.0f,
                           c->labels.data(),      c->members.data(),
                           c->next_labels.data(), near_sums.data(),
                           far_sums.data(),       PhaseStride(step)};
  return kernel(Phases(step), args, splits ? &split : nullptr);
}

TEST_F(RowKernels, WeighRowEqualsItsOracleOnEachTarget) {
  constexpr size_t kDimensions = 5;
  const auto rows = [&](size_t count) {
    std::vector<Row> all;
    for (size_t i = 0; i < count; ++i) all.push_back(Random(kPhasedRoom, 0.6f));
    return all;
  };
  WeighCase start{rows(kDimensions),
                  rows(kDimensions + 1),
                  rows(kDimensions + 1),
                  Random(kDimensions * kRoom, 0.6f),
                  Row(kPhasedRoom),
                  Random(kPhasedRoom),
                  Random(),
                  Row(kPhasedRoom),
                  Random(kPhasedRoom),
                  Random(kPhasedRoom)};
  start.features[0][5] = 40;  // beyond reach of the manifold
  for (size_t x = 0; x < kPhasedRoom; ++x) start.labels[x] = static_cast<float>(x / 20 % 4);
  OnEachTarget([&] {
    for (const int step : kSteps) {
      for (const int count : kCounts) {
        if (count * step > kStripColumns) continue;
        for (const bool splits : {false, true}) {
          WeighCase fast = start;
          WeighCase slow = start;
          const bool found = RunWeigh(WeighRow, step, count, splits, &fast);
          const bool expected = RunWeigh(oracle::WeighRow, step, count, splits, &slow);
          EXPECT_TRUE(found || !expected);
          for (int phase = 0; phase < step; ++phase) {
            const std::ptrdiff_t at = phase * PhaseStride(step);
            ExpectSame(fast.weight, slow.weight, count, at);
            ExpectSame(fast.total, slow.total, count, at);
            ExpectSame(fast.members, slow.members, count, at);
            ExpectSame(fast.next_labels, slow.next_labels, count, at);
            ExpectSame(fast.near_sums, slow.near_sums, count, at);
            ExpectSame(fast.far_sums, slow.far_sums, count, at);
          }
        }
      }
    }
  });
}

TEST_F(RowKernels, SplatRowEqualsItsOracleOnEachTarget) {
  std::vector<Row> signals = RandomRows(3);
  const std::vector<Row> start = RandomRows(4);
  const Row mask = Random();
  Row some = Random();
  for (size_t x = 8; x < 40; ++x) some[x] = 0;  // pixels that are far from the manifold
  for (const Row& weight : {some, Row(kRoom)}) {
    OnEachTarget([&] {
      for (const int count : kCounts) {
        std::vector<Row> fast = start;
        std::vector<Row> slow = start;
        const auto rows = Pointers<const float*>(signals);
        const auto run = [&](bool (*kernel)(const SplatArgs&), std::vector<Row>* sums) {
          return kernel(
              {rows.data(), rows.size(), mask.data(), weight.data(), Pointers<float*>(*sums).data(), count});
        };
        const bool found = run(SplatRow, &fast);
        const bool expected = run(oracle::SplatRow, &slow);
        EXPECT_TRUE(found || !expected);
        ExpectSame(fast, slow, count);
      }
    });
  }
}

TEST_F(RowKernels, SliceRowEqualsItsOracleOnEachTarget) {
  constexpr size_t kManifolds = 3;
  constexpr size_t kPlanes = 5;
  std::vector<Row> weights, start;
  for (size_t i = 0; i < kManifolds; ++i) weights.push_back(Random(kPhasedRoom));
  std::fill_n(weights[1].begin(), 40, 0.0f);  // far from the manifold
  for (size_t k = 0; k < kPlanes; ++k) start.push_back(Random(kPhasedRoom));
  const Row psi = Random(kManifolds * kPlanes * kRoom);
  const auto weight_rows = Pointers<const float*>(weights);
  OnEachTarget([&] {
    for (const int step : kSteps) {
      for (const int count : kCounts) {
        if (count * step > kStripColumns) continue;
        for (const bool adds : {false, true}) {
          std::vector<Row> fast = start;
          std::vector<Row> slow = start;
          const auto run = [&](void (*kernel)(const Phases&, const SliceArgs&), std::vector<Row>* sums) {
            const auto sum_rows = Pointers<float*>(*sums);
            kernel(Phases(step), {weight_rows.data(), kManifolds, psi.data(), kRoom, kPlanes, sum_rows.data(),
                                  adds, PhaseStride(step), count});
          };
          run(SliceRow, &fast);
          run(oracle::SliceRow, &slow);
          for (int phase = 0; phase < step; ++phase) ExpectSame(fast, slow, count, phase * PhaseStride(step));
        }
      }
    }
  });
}

TEST_F(RowKernels, BlendCellsEqualsItsOracleAndClampsAtBothEnds) {
  std::vector<Row> upper = RandomRows(2);
  std::vector<Row> lower = RandomRows(2);
  const auto upper_rows = Pointers<const float*>(upper);
  const auto lower_rows = Pointers<const float*>(lower);
  OnEachTarget([&] {
    for (const int columns : kCounts) {
      for (const int first : {-1, 0, 3, columns / 2}) {
        if (first >= columns) continue;
        Row fast(2 * kRoom);
        Row slow(2 * kRoom);
        const auto args = [&](Row* out) {
          const int count = std::min(columns + 3, kStripColumns + 2);
          return BlendArgs{upper_rows.data(), lower_rows.data(), 0.375f, 2, first, count,
                           columns,           out->data(),       kRoom};
        };
        BlendCells(args(&fast));
        oracle::BlendCells(args(&slow));
        ExpectSame(fast, slow, static_cast<int>(fast.size()));
      }
    }
  });
}

TEST_F(RowKernels, PlainRowsEqualTheirOraclesAtAnyOffsetOnEachTarget) {
  const Row a = Random();
  const Row b = Random();
  const Row d = Random();
  OnEachTarget([&] {
    for (const int count : kCounts) {
      for (const int offset : {0, 1, 5}) {
        const auto check = [&](auto kernel, auto oracle) {
          Row fast = d;
          Row slow = d;
          kernel(fast.data() + offset);
          oracle(slow.data() + offset);
          ExpectSame(fast, slow, static_cast<int>(kRoom));
        };
        check([&](float* out) { AddProductRow(a.data() + offset, b.data(), count, out); },
              [&](float* out) { oracle::AddProductRow(a.data() + offset, b.data(), count, out); });
        check([&](float* out) { QuotientRow(a.data() + offset, 0.2f, b.data(), count, out); },
              [&](float* out) { oracle::QuotientRow(a.data() + offset, 0.2f, b.data(), count, out); });
        check([&](float* out) { StabiliseRow(a.data() + offset, 7.5f, 0.25f, count, out); },
              [&](float* out) { oracle::StabiliseRow(a.data() + offset, 7.5f, 0.25f, count, out); });
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

TEST_F(RowKernels, SumPhasesEqualsItsOracleOnEachTarget) {
  const Row start = Random(kPhasedRoom);
  OnEachTarget([&] {
    for (const int step : kSteps) {
      for (const int count : kCounts) {
        if (count * step > kStripColumns) continue;
        Row fast = start;
        Row slow = start;
        Row fast_means(kRoom, 9.0f);
        Row slow_means(kRoom, 9.0f);
        SumPhases(fast.data(), PhaseStride(step), step, 0.25f, count, fast_means.data());
        oracle::SumPhases(slow.data(), PhaseStride(step), step, 0.25f, count, slow_means.data());
        ExpectSame(fast_means, slow_means, static_cast<int>(kRoom));
        ExpectSame(fast, slow, static_cast<int>(kPhasedRoom));
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
