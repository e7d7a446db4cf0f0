#include "tests/charts/methods/rendering/sample_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace lumifold::charts {
namespace {

using Point = SampleTree::Point;

SampleTree RandomTree(int dimensions, size_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0, 1);
  Point size{};
  for (int axis = 0; axis < dimensions; ++axis)
    size[static_cast<size_t>(axis)] = static_cast<float>(axis + 1);
  SampleTree tree(dimensions, size);
  for (size_t i = 0; i < count; ++i) {
    SampleTree::Sample sample;
    for (size_t axis = 0; axis < static_cast<size_t>(dimensions); ++axis)
      sample.at[axis] = size[axis] * uniform(random);
    sample.value = {sample.at[0], 1, uniform(random)};
    tree.Insert(sample);
  }
  return tree;
}

TEST(SampleTree, KeepsEachSampleInALeafRoundIt) {
  for (const int dimensions : {1, 2, 4}) {
    const SampleTree tree = RandomTree(dimensions, 1000, 1);
    ASSERT_EQ(tree.samples().size(), 1000u);
    size_t found = 0;
    for (size_t leaf = 0; leaf < tree.nodes().size(); ++leaf) {
      if (!tree.IsLeaf(leaf)) continue;
      for (const uint32_t i : tree.SamplesOf(leaf)) {
        ++found;
        EXPECT_EQ(tree.LeafAt(tree.samples()[i].at), leaf);
        for (size_t axis = 0; axis < static_cast<size_t>(dimensions); ++axis) {
          EXPECT_GE(tree.samples()[i].at[axis], tree.nodes()[leaf].least[axis]);
          EXPECT_LE(tree.samples()[i].at[axis], tree.nodes()[leaf].most[axis]);
        }
      }
    }
    EXPECT_EQ(found, 1000u);
  }
}

TEST(SampleTree, FindsTheNearestAsASlowSearchDoes) {
  for (const int dimensions : {2, 4}) {
    const SampleTree tree = RandomTree(dimensions, 500, 2);
    const SampleTree queries = RandomTree(dimensions, 40, 3);
    for (const SampleTree::Sample& query : queries.samples()) {
      std::vector<std::pair<float, uint32_t>> slow;
      for (uint32_t i = 0; i < 500; ++i) {
        float distance = 0;
        for (size_t axis = 0; axis < 4; ++axis) {
          const float step = query.at[axis] - tree.samples()[i].at[axis];
          distance += step * step;
        }
        slow.emplace_back(distance, i);
      }
      std::sort(slow.begin(), slow.end());
      std::array<uint32_t, 16> near;
      ASSERT_EQ(tree.Nearest(query.at, near), 16u);
      for (size_t i = 0; i < 16; ++i) EXPECT_EQ(near[i], slow[i].second);
    }
  }
}

TEST(SampleTree, FindsNoMoreThanThereIs) {
  const SampleTree tree = RandomTree(2, 3, 4);
  std::array<uint32_t, 16> near;
  EXPECT_EQ(tree.Nearest({0, 0, 0, 0}, near), 3u);
  EXPECT_EQ(SampleTree(2, {1, 1, 0, 0}).Nearest({0, 0, 0, 0}, near), 0u);
  EXPECT_EQ(tree.Nearest({0, 0, 0, 0}, {}), 0u);
}

TEST(SampleTree, LeavesOutWhatNoSplitTellsApart) {
  SampleTree tree(2, {1, 1, 0, 0});
  for (int i = 0; i < 10; ++i) tree.Insert({{0.5f, 0.25f, 0, 0}, {1, 1, 1}});
  EXPECT_EQ(tree.samples().size(), SampleTree::kLeafSamples);
  for (int i = 0; i < 3; ++i) tree.Insert({{0.5f, 0.75f, 0, 0}, {1, 1, 1}});
  EXPECT_EQ(tree.samples().size(), SampleTree::kLeafSamples + 3);
}

TEST(SampleTree, SeesErrorWhereSamplesDiffer) {
  SampleTree even(2, {2, 1, 0, 0});
  SampleTree uneven(2, {2, 1, 0, 0});
  for (int i = 0; i < 4; ++i) {
    const float value = i % 2 == 0 ? 1.0f : 3.0f;
    const Point at = {0.4f * static_cast<float>(i), 0.5f, 0, 0};
    even.Insert({at, {2, 2, 2}});
    uneven.Insert({at, {value, 2, 2}});
  }
  EXPECT_NEAR(even.ErrorOf(0), 2 * 1e-5f, 1e-9f);
  EXPECT_NEAR(uneven.ErrorOf(0), 2 * (0.5f + 1e-5f), 1e-5f);
  EXPECT_GT(SampleTree(2, {1, 1, 0, 0}).ErrorOf(0), 0);
}

}  // namespace
}  // namespace lumifold::charts
