#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "worker/scene/vec.h"

namespace lumifold::charts {

/// A k-d tree of samples of a function of few dimensions. A leaf is a box with at most kLeafSamples samples.
/// Threads: const calls are safe concurrently while no thread calls Insert().
class SampleTree {
 public:
  static constexpr int kMostDimensions = 4;
  static constexpr size_t kLeafSamples = 4;

  /// Unused dimensions are 0.
  using Point = std::array<float, kMostDimensions>;

  struct Sample {
    Point at{};
    scene::Vec3 value;
  };

  /// A box that is a leaf, or has two children separated at `split` along `axis`.
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

  /// A sample at the same point as all samples of a full leaf is dropped.
  void Insert(const Sample& sample);

  int dimensions() const { return dimensions_; }
  const std::vector<Sample>& samples() const { return samples_; }
  const std::vector<Node>& nodes() const { return nodes_; }
  bool IsLeaf(size_t node) const { return nodes_[node].axis < 0; }
  std::span<const uint32_t> SamplesOf(size_t leaf) const {
    return {nodes_[leaf].samples.data(), nodes_[leaf].count};
  }
  /// The leaf that contains a point.
  size_t LeafAt(const Point& point) const;

  /// A leaf's volume times the mean absolute deviation of its samples relative to their mean, summed over
  /// channels: an estimate of its part of the integral's error. Never 0, so that empty boxes are sampled as
  /// well.
  float ErrorOf(size_t leaf) const;

  /// Finds the samples nearest to a point, nearest first; of equal distances the lower number first. Result:
  /// their number, which is less than the size of `found` if there are fewer samples.
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
