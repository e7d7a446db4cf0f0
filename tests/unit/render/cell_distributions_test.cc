#include "worker/render/lights/cell_distributions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/mix_bits.h"

namespace lumifold::render {
namespace {

float NumberOf(uint64_t i) { return static_cast<float>(MixBits(i) >> 40) * 0x1p-24f; }

/// Weights of a row of a sky: dark parts, a gradient, and a sun.
std::vector<double> Weights(int cells, int kind) {
  std::vector<double> weights;
  for (int i = 0; i < cells; ++i) {
    const auto u = static_cast<double>(NumberOf(static_cast<uint64_t>(1000 * kind + i)));
    const bool is_sun = i == cells / 3;
    switch (kind) {
      case 0:
        weights.push_back(1);
        break;
      case 1:
        weights.push_back(is_sun ? 1e7 : u);
        break;
      case 2:
        weights.push_back(u < 0.7 ? 0 : u);
        break;
      case 3:
        weights.push_back(is_sun ? 1 : 0);
        break;
      default:
        weights.push_back(0);
        break;
    }
  }
  return weights;
}

/// The edges of the cells by the definition of Fill().
std::vector<float> EdgesOf(const std::vector<double>& weights) {
  double total = 0;
  for (const double weight : weights) total += weight;
  std::vector<float> edges;
  double sum = 0;
  for (const double weight : weights) {
    edges.push_back(static_cast<float>(
        total > 0 ? sum / total : static_cast<double>(edges.size()) / static_cast<double>(weights.size())));
    sum += weight;
  }
  edges.push_back(1);
  return edges;
}

TEST(CellDistributions, SelectTheCellOfABinarySearch) {
  constexpr int kKinds = 5;
  for (const int cells : {1, 2, 3, 5, 64, 100, 1000, 2048, 5000}) {
    CellDistributions distributions(kKinds, cells);
    for (int kind = 0; kind < kKinds; ++kind) distributions.Fill(kind, Weights(cells, kind).data());
    for (int kind = 0; kind < kKinds; ++kind) {
      const std::vector<float> edges = EdgesOf(Weights(cells, kind));
      std::vector<float> numbers;
      for (uint64_t i = 0; i < 20000; ++i) {
        numbers.push_back(NumberOf(i));
        numbers.push_back(static_cast<float>(i) / 20000.0f);
      }
      for (const float edge : edges) {
        for (const float near : {std::nextafter(edge, 0.0f), edge, std::nextafter(edge, 1.0f)})
          numbers.push_back(std::min(near, 0x1.fffffep-1f));
      }
      for (const float u : numbers) {
        const auto above = std::upper_bound(edges.begin() + 1, edges.end() - 1, u);
        const auto expected = static_cast<int>(above - edges.begin()) - 1;
        const CellDistributions::Pick pick = distributions.Sample(kind, u);
        ASSERT_EQ(pick.cell, expected) << cells << " cells, kind " << kind << ", " << u;
        ASSERT_GE(pick.fraction, 0);
        ASSERT_LE(pick.fraction, 1);
      }
    }
  }
}

TEST(CellDistributions, SharesAreInProportionToWeights) {
  CellDistributions distributions(2, 4);
  EXPECT_DOUBLE_EQ(distributions.Fill(1, std::vector<double>{1, 0, 4, 3}.data()), 8);
  EXPECT_DOUBLE_EQ(distributions.Fill(0, std::vector<double>{0, 0, 0, 0}.data()), 0);
  EXPECT_FLOAT_EQ(distributions.Share(1, 0), 0.125f);
  EXPECT_EQ(distributions.Share(1, 1), 0);
  EXPECT_FLOAT_EQ(distributions.Share(1, 2), 0.5f);
  EXPECT_FLOAT_EQ(distributions.Share(0, 3), 0.25f);
}

}  // namespace
}  // namespace lumifold::render
