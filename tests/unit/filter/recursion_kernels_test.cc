#include "filter/kernels/recursion_kernels.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "tests/unit/filter/kernel_oracles.h"
#include "tests/unit/filter/kernel_rows.h"

namespace lumifold::filter {
namespace {

using RecursionKernels = KernelTest;

std::vector<Row> LinksOf(std::vector<Row> rows) {
  for (Row& row : rows) {
    for (float& weight : row) weight = std::abs(std::fmod(weight, 1.0f));
  }
  return rows;
}

TEST_F(RecursionKernels, RecurseRowsEqualsItsOracleForAnyNumberOfRowsOnEachTarget) {
  constexpr size_t kSignals[] = {1, 3, 4, 5};
  std::vector<Row> from = RandomRows(5 * 37);
  std::vector<Row> weights = LinksOf(RandomRows(37));
  const auto links = Pointers<const float*>(weights);
  const auto sources = Pointers<const float*>(from);
  OnEachTarget([&] {
    for (const size_t signals : kSignals) {
      for (const size_t rows : {1u, 15u, 16u, 37u}) {
        for (const int count : {1, 4, 5, 6, 17, 100}) {
          std::vector<Row> fast = from;
          std::vector<Row> slow = from;
          const auto in_place = Pointers<float*>(slow);
          RecurseRows({sources.data(), Pointers<float*>(fast).data(), signals, rows, count}, links.data());
          oracle::RecurseRows({in_place.data(), in_place.data(), signals, rows, count}, links.data());
          ExpectSame(fast, slow, static_cast<int>(kRoom));
        }
      }
    }
  });
}

TEST_F(RecursionKernels, RecurseRowsEvenlyEqualsItsOracleForAnyNumberOfRowsOnEachTarget) {
  std::vector<Row> from = RandomRows(83);
  const auto sources = Pointers<const float*>(from);
  OnEachTarget([&] {
    for (const size_t rows : {1u, 16u, 63u, 64u, 83u}) {
      for (const int count : kCounts) {
        std::vector<Row> fast = from;
        std::vector<Row> slow = from;
        const auto in_place = Pointers<float*>(fast);
        RecurseRowsEvenly({in_place.data(), in_place.data(), 1, rows, count}, 0.375f);
        oracle::RecurseRowsEvenly({sources.data(), Pointers<float*>(slow).data(), 1, rows, count}, 0.375f);
        ExpectSame(fast, slow, static_cast<int>(kRoom));
      }
    }
  });
}

TEST_F(RecursionKernels, PullRowsEqualTheirOraclesAtAnyOffsetOnEachTarget) {
  const Row weight = Random();
  const Row from = Random();
  const Row start = Random();
  OnEachTarget([&] {
    for (const int count : kCounts) {
      for (const size_t offset : {0u, 1u, 5u}) {
        Row fast = start;
        Row slow = start;
        PullRow(weight.data(), from.data(), count, fast.data() + offset);
        oracle::PullRow(weight.data(), from.data(), count, slow.data() + offset);
        ExpectSame(fast, slow, static_cast<int>(kRoom));
        PullRowEvenly(0.4f, from.data(), count, fast.data() + offset);
        oracle::PullRowEvenly(0.4f, from.data(), count, slow.data() + offset);
        ExpectSame(fast, slow, static_cast<int>(kRoom));
      }
    }
  });
}

TEST_F(RecursionKernels, LinkRowEqualsItsOracleOnEachTarget) {
  std::vector<Row> here = RandomRows(4);
  std::vector<Row> there = RandomRows(4);
  const auto here_rows = Pointers<const float*>(here);
  const auto there_rows = Pointers<const float*>(there);
  constexpr std::array<LinkReach, 2> kReaches = {LinkReach{4.0f, 32.0f}, LinkReach{0.75f, 1.125f}};
  OnEachTarget([&] {
    for (const int count : kCounts) {
      const LinkArgs args = {here_rows.data(), there_rows.data(), here.size(), count};
      for (const LinkReach& reach : kReaches) {
        Row fast(kRoom);
        Row slow(kRoom);
        LinkRow(args, reach, fast.data());
        LinkNarrowRow(args, reach, slow.data());
        ExpectSame(fast, slow, static_cast<int>(kRoom));
      }
    }
  });
}

}  // namespace
}  // namespace lumifold::filter
