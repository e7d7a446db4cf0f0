#pragma once

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "filter/kernels/row_kernels.h"

namespace lumifold::filter {

using Row = std::vector<float>;

/// Widths around those of vectors, strips and cells.
inline constexpr int kCounts[] = {1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 63, 64, 65, 100, 255, 256};
inline constexpr int kSteps[] = {1, 2, 4, 8, 16, 32, 64};
inline constexpr size_t kRoom = kStripColumns + kRowPadding + kCellPadding + 2;
inline constexpr size_t kPhasedRoom = kStripColumns + 64 * kRowPadding;  // each phase is padded

/// Runs `check` with each instruction set that this program and this processor have.
template <typename Check>
void OnEachTarget(Check check) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(hwy::TargetName(target));
    check();
  }
  hwy::SetSupportedTargetsForTest(0);
}

class KernelTest : public testing::Test {
 protected:
  Row Random(size_t count = kRoom, float scale = 1.5f) {
    Row row(count);
    std::normal_distribution<float> normal(0.0f, scale);
    for (float& value : row) value = normal(random_);
    return row;
  }

  std::vector<Row> RandomRows(size_t rows, float scale = 1.5f) {
    std::vector<Row> result(rows);
    for (Row& row : result) row = Random(kRoom, scale);
    return result;
  }

  std::mt19937 random_{7};
};

/// The `count` floats from `first` on are the same bits (but for the sign of zero).
inline void ExpectSame(const Row& a, const Row& b, int count, std::ptrdiff_t first = 0) {
  for (std::ptrdiff_t x = first; x < first + count; ++x)
    ASSERT_EQ(a.data()[x], b.data()[x]) << x << " of " << count;
}

inline void ExpectSame(const std::vector<Row>& a, const std::vector<Row>& b, int count,
                       std::ptrdiff_t first = 0) {
  for (size_t i = 0; i < a.size(); ++i) ExpectSame(a[i], b[i], count, first);
}

template <typename Pointer>
std::vector<Pointer> Pointers(std::vector<Row>& rows) {
  std::vector<Pointer> pointers;
  pointers.reserve(rows.size());
  for (Row& row : rows) pointers.push_back(row.data());
  return pointers;
}

}  // namespace lumifold::filter
