#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/scene/vec.h"

namespace lumifold::charts {

/// A tree of samples of a function of a few dimensions: each leaf is a box with at most kLeafSamples of them.
/// Threads: reading calls are safe concurrently while nobody calls Insert().
class SampleTree {
 public:
  static constexpr int kMostDimensions = 4;
  static constexpr size_t kLeafSamples = 4;

  /// Places that are not used stay 0.
  using Point = std::array<float, kMostDimensions>;

  struct Sample {
    Point at{};
    scene::Vec3 value;
  };

  /// A box without children, or with two whose border is at `split` along `axis`.
  struct Node {
    Point least{};
    Point most{};
    int axis = -1;  // -1: a leaf
    float split = 0;
    size_t child = 0;  // the lower one; the upper one follows
    std::array<uint32_t, kLeafSamples> samples{};
    uint8_t count = 0;
  };

  /// The box from 0 to `size`, whose first `dimensions` sides are above 0.
  SampleTree(int dimensions, const Point& size);

  /// A sample that lies where all of a full leaf do is left out.
  void Insert(const Sample& sample);

  int dimensions() const { return dimensions_; }
  const std::vector<Sample>& samples() const { return samples_; }
  const std::vector<Node>& nodes() const { return nodes_; }
  bool IsLeaf(size_t node) const { return nodes_[node].axis < 0; }
  std::span<const uint32_t> SamplesOf(size_t leaf) const {
    return {nodes_[leaf].samples.data(), nodes_[leaf].count};
  }
  /// The number of the leaf a point lies in.
  size_t LeafAt(const Point& point) const;

  /// A leaf's volume times how much its samples differ, against their mean, in all channels: what it adds to
  /// the error of the integral, about. Never 0, so that empty boxes get their turn.
  float ErrorOf(size_t leaf) const;

  /// The samples nearest to a point, nearest first (of equals the one of lower number); fewer than `found`
  /// holds where there are fewer. Gives their number.
  size_t Nearest(const Point& point, std::span<uint32_t> found) const;

 private:
  class Search;

  bool Split(size_t leaf, const Sample& further);
  float DistanceSquared(const Point& a, const Point& b) const;

  int dimensions_;
  std::vector<Sample> samples_;
  std::vector<Node> nodes_;
};

}  // namespace lumifold::charts
