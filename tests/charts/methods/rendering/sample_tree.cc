#include "tests/charts/methods/rendering/sample_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "filter/image/check.h"

namespace lumifold::charts {

using scene::Vec3;

SampleTree::SampleTree(int dimensions, const Point& size) : dimensions_(dimensions), nodes_(1) {
  LUMIFOLD_CHECK(dimensions >= 1 && dimensions <= kMostDimensions);
  nodes_[0].most = size;
}

size_t SampleTree::LeafAt(const Point& point) const {
  size_t node = 0;
  while (!IsLeaf(node)) {
    const Node& at = nodes_[node];
    node = at.child + (point[static_cast<size_t>(at.axis)] >= at.split ? 1 : 0);
  }
  return node;
}

void SampleTree::Insert(const Sample& sample) {
  size_t leaf = LeafAt(sample.at);
  while (nodes_[leaf].count == kLeafSamples) {
    if (!Split(leaf, sample)) return;
    leaf = nodes_[leaf].child +
           (sample.at[static_cast<size_t>(nodes_[leaf].axis)] >= nodes_[leaf].split ? 1 : 0);
  }
  Node& node = nodes_[leaf];
  node.samples[node.count++] = static_cast<uint32_t>(samples_.size());
  samples_.push_back(sample);
}

/// Splits along the longest side on which the samples and the `further` one differ, halfway between the two
/// of median rank.
bool SampleTree::Split(size_t leaf, const Sample& further) {
  const Node parent = nodes_[leaf];
  int best = -1;
  std::array<float, kLeafSamples + 1> places{};
  for (int axis = 0; axis < dimensions_; ++axis) {
    const auto a = static_cast<size_t>(axis);
    const auto side = [&](int i) {
      return parent.most[static_cast<size_t>(i)] - parent.least[static_cast<size_t>(i)];
    };
    const bool differs = std::any_of(parent.samples.begin(), parent.samples.end(),
                                     [&](uint32_t i) { return samples_[i].at[a] != further.at[a]; });
    if (differs && (best < 0 || side(axis) > side(best))) best = axis;
  }
  if (best < 0) return false;
  const auto axis = static_cast<size_t>(best);
  for (size_t i = 0; i < kLeafSamples; ++i) places[i] = samples_[parent.samples[i]].at[axis];
  places.back() = further.at[axis];
  std::sort(places.begin(), places.end());
  // Above the smallest coordinate, so that both children have a sample.
  size_t upper = places.size() / 2;
  while (places[upper] == places[upper - 1] && upper + 1 < places.size()) ++upper;
  while (places[upper] == places[upper - 1]) --upper;
  const float middle = 0.5f * (places[upper - 1] + places[upper]);
  const float split = middle > places[upper - 1] ? middle : places[upper];

  std::array<Node, 2> children;
  for (Node& child : children) {
    child.least = parent.least;
    child.most = parent.most;
  }
  children[0].most[axis] = split;
  children[1].least[axis] = split;
  for (const uint32_t i : parent.samples) {
    Node& child = children[samples_[i].at[axis] >= split ? 1 : 0];
    child.samples[child.count++] = i;
  }
  nodes_[leaf].axis = best;
  nodes_[leaf].split = split;
  nodes_[leaf].child = nodes_.size();
  nodes_.insert(nodes_.end(), children.begin(), children.end());
  return true;
}

float SampleTree::ErrorOf(size_t leaf) const {
  constexpr float kLeastContrast = 1e-5f;
  constexpr float kBlack = 1e-20f;
  const Node& node = nodes_[leaf];
  float volume = 1;
  for (int axis = 0; axis < dimensions_; ++axis)
    volume *= node.most[static_cast<size_t>(axis)] - node.least[static_cast<size_t>(axis)];
  if (node.count == 0) return volume * kLeastContrast;
  const float share = 1 / static_cast<float>(node.count);
  Vec3 mean;
  for (const uint32_t i : SamplesOf(leaf)) mean += samples_[i].value * share;
  Vec3 away;
  for (const uint32_t i : SamplesOf(leaf)) {
    const Vec3 difference = samples_[i].value - mean;
    away += Vec3{std::abs(difference.x), std::abs(difference.y), std::abs(difference.z)} * share;
  }
  const auto contrast = [](float deviation, float level) {
    return level > kBlack ? deviation / level : 0.0f;
  };
  return volume *
         (contrast(away.x, mean.x) + contrast(away.y, mean.y) + contrast(away.z, mean.z) + kLeastContrast);
}

float SampleTree::DistanceSquared(const Point& a, const Point& b) const {
  float sum = 0;
  for (int axis = 0; axis < dimensions_; ++axis) {
    const float difference = a[static_cast<size_t>(axis)] - b[static_cast<size_t>(axis)];
    sum += difference * difference;
  }
  return sum;
}

/// Nearest-neighbour search, nearer child first.
class SampleTree::Search {
 public:
  Search(const SampleTree& tree, const Point& point, std::span<uint32_t> found)
      : tree_(tree),
        point_(point),
        found_(found),
        distances_(found.size(), std::numeric_limits<float>::infinity()) {}

  size_t Run() {
    Visit(0);
    return count_;
  }

 private:
  void Visit(size_t number) {
    const Node& node = tree_.nodes_[number];
    if (node.axis < 0) {
      for (const uint32_t sample : tree_.SamplesOf(number)) Add(sample);
      return;
    }
    const float away = point_[static_cast<size_t>(node.axis)] - node.split;
    const size_t near = away >= 0 ? 1 : 0;
    Visit(node.child + near);
    if (away * away <= distances_.back()) Visit(node.child + 1 - near);
  }

  void Add(uint32_t sample) {
    const float distance = tree_.DistanceSquared(point_, tree_.samples_[sample].at);
    const auto is_before = [&](size_t other) {
      return distance < distances_[other] || (distance == distances_[other] && sample < found_[other]);
    };
    if (count_ == found_.size() && !is_before(count_ - 1)) return;
    if (count_ < found_.size()) ++count_;
    size_t at = count_ - 1;
    for (; at > 0 && is_before(at - 1); --at) {
      distances_[at] = distances_[at - 1];
      found_[at] = found_[at - 1];
    }
    distances_[at] = distance;
    found_[at] = sample;
  }

  const SampleTree& tree_;
  const Point& point_;
  std::span<uint32_t> found_;
  std::vector<float> distances_;
  size_t count_ = 0;
};

size_t SampleTree::Nearest(const Point& point, std::span<uint32_t> found) const {
  return found.empty() ? 0 : Search(*this, point, found).Run();
}

}  // namespace lumifold::charts
