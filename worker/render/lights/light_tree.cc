#include "worker/render/lights/light_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

using scene::Bounds;
using scene::Vec3;

constexpr uint64_t kNotInTree = ~uint64_t{0};

/// Deeper nodes are split into halves of equal count, so that a bit trail fits 64 bits.
constexpr int kMaxCostDepth = 32;

constexpr int kBuckets = 12;

void Include(const Bounds& more, Bounds* box) {
  box->min = {std::min(box->min.x, more.min.x), std::min(box->min.y, more.min.y),
              std::min(box->min.z, more.min.z)};
  box->max = {std::max(box->max.x, more.max.x), std::max(box->max.y, more.max.y),
              std::max(box->max.z, more.max.z)};
}

Vec3 CenterOf(const Bounds& box) { return (box.min + box.max) * 0.5f; }

/// Extends the cone of `a` so that it contains the cone of `b`.
void IncludeCone(const EmitterBounds& b, EmitterBounds* a) {
  a->falloff = std::max(a->falloff, b.falloff);
  const bool both_sides = a->both_sides || b.both_sides;
  Vec3 other = b.axis;
  float cosine = Dot(a->axis, other);
  if (both_sides && cosine < 0) {
    other = -other;
    cosine = -cosine;
  }
  a->both_sides = both_sides;
  const float between = Acos(cosine);
  if (std::min(between + b.spread, kPi) <= a->spread) return;
  if (std::min(between + a->spread, kPi) <= b.spread) {
    a->axis = other;
    a->spread = b.spread;
    return;
  }
  const float spread = 0.5f * (a->spread + between + b.spread);
  const Vec3 across = other - a->axis * cosine;
  if (spread >= kPi || LengthSquared(across) <= 0) {
    a->spread = kPi;
    return;
  }
  float sine = 0;
  SinCos(spread - a->spread, &sine, &cosine);
  a->axis = Normalize(a->axis * cosine + Normalize(across) * sine);
  a->spread = spread;
}

/// Bounds of the union of two groups; a group of power 0 is ignored.
void Include(const EmitterBounds& b, EmitterBounds* a) {
  if (b.power <= 0) return;
  if (a->power <= 0) {
    *a = b;
    return;
  }
  Include(b.box, &a->box);
  a->power += b.power;
  IncludeCone(b, a);
}

/// Measure of the directions in which the group emits (the paper's M_omega).
double OrientationMeasure(const EmitterBounds& b) {
  const float reach = std::min(b.spread + b.falloff, kPi);
  float sin_spread = 0;
  float cos_spread = 0;
  SinCos(b.spread, &sin_spread, &cos_spread);
  float sin_turn = 0;
  float cos_turn = 0;
  SinCos(b.spread - 2 * reach, &sin_turn, &cos_turn);
  return static_cast<double>(
      2 * kPi * (1 - cos_spread) +
      kPi / 2 * (2 * reach * sin_spread - cos_turn - 2 * b.spread * sin_spread + cos_spread));
}

/// Estimated variance of sampling from the group. Uses the box's squared diagonal instead of the paper's
/// surface area, which is 0 for lights in a row.
double Cost(const EmitterBounds& b) {
  if (b.power <= 0) return 0;
  return b.power * OrientationMeasure(b) * static_cast<double>(LengthSquared(b.box.max - b.box.min));
}

/// Cosine and sine of max(0, a - b), from the sines and cosines of a and b.
float CosineOfDifference(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 1.0f : cos_a * cos_b + sin_a * sin_b;
}
float SineOfDifference(float sin_a, float cos_a, float sin_b, float cos_b) {
  return cos_a > cos_b ? 0.0f : sin_a * cos_b - cos_a * sin_b;
}

float SineOf(float cosine) { return std::sqrt(std::max(0.0f, 1.0f - cosine * cosine)); }

}  // namespace

/// Builds the nodes in depth-first order.
struct LightTree::Builder {
  std::span<const EmitterBounds> emitters;
  std::vector<Node>* nodes;
  std::vector<uint64_t>* bit_trails;

  EmitterBounds BoundsOf(std::span<const uint32_t> range) const {
    EmitterBounds all;
    for (const uint32_t i : range) Include(emitters[i], &all);
    return all;
  }

  void Build(std::span<uint32_t> range, uint64_t bit_trail, int depth) {
    const size_t index = nodes->size();
    nodes->push_back(MakeNode(BoundsOf(range)));
    if (range.size() == 1) {
      (*nodes)[index].link = kLeaf | range[0];
      (*bit_trails)[range[0]] = bit_trail;
      return;
    }
    const size_t middle = Split(range, depth);
    Build(range.first(middle), bit_trail, depth + 1);
    (*nodes)[index].link = static_cast<uint32_t>(nodes->size());
    Build(range.subspan(middle), bit_trail | uint64_t{1} << depth, depth + 1);
  }

  static Node MakeNode(const EmitterBounds& bounds) {
    Node node;
    node.center = CenterOf(bounds.box);
    node.radius = 0.5f * Length(bounds.box.max - bounds.box.min);
    node.axis = bounds.axis;
    SinCos(bounds.spread, &node.sin_spread, &node.cos_spread);
    float unused = 0;
    SinCos(bounds.falloff, &unused, &node.cos_falloff);
    node.power = static_cast<float>(bounds.power);
    node.both_sides = bounds.both_sides;
    return node;
  }

  struct Cut {
    int axis = -1;
    int bucket = 0;  // the last one of the first child
    double cost = std::numeric_limits<double>::infinity();
  };

  static int BucketOf(Vec3 point, const Bounds& centers, int axis) {
    const float extent = centers.max[axis] - centers.min[axis];
    const float place = (point[axis] - centers.min[axis]) / extent;
    return std::clamp(static_cast<int>(place * kBuckets), 0, kBuckets - 1);
  }

  void TryAxis(std::span<const uint32_t> range, const Bounds& centers, int axis, Cut* best) const {
    const Vec3 extent = centers.max - centers.min;
    std::array<EmitterBounds, kBuckets> buckets;
    for (const uint32_t i : range)
      Include(emitters[i], &buckets[BucketOf(CenterOf(emitters[i].box), centers, axis)]);
    std::array<double, kBuckets> cost_behind = {};  // of all buckets behind each
    EmitterBounds sum;
    for (int b = kBuckets - 1; b > 0; --b) {
      Include(buckets[b], &sum);
      cost_behind[b - 1] = Cost(sum);
    }
    sum = {};
    const double stretch = static_cast<double>(MaxComponent(extent) / extent[axis]);
    for (int b = 0; b + 1 < kBuckets; ++b) {
      Include(buckets[b], &sum);
      const double cost = stretch * (Cost(sum) + cost_behind[b]);
      if (cost < best->cost) *best = {axis, b, cost};
    }
  }

  /// Partitions `range` for the two children and returns the size of the first part. Neither part is empty.
  size_t Split(std::span<uint32_t> range, int depth) const {
    Bounds centers;
    for (const uint32_t i : range) {
      const Vec3 center = CenterOf(emitters[i].box);
      Include({center, center}, &centers);
    }
    Cut best;
    for (int axis = 0; axis < 3 && depth < kMaxCostDepth; ++axis) {
      if (centers.max[axis] > centers.min[axis]) TryAxis(range, centers, axis, &best);
    }
    const size_t half = range.size() / 2;
    if (best.axis < 0) return half;
    const auto in_first = [&](uint32_t i) {
      return BucketOf(CenterOf(emitters[i].box), centers, best.axis) <= best.bucket;
    };
    const auto middle = std::stable_partition(range.begin(), range.end(), in_first);
    const auto size = static_cast<size_t>(middle - range.begin());
    return size == 0 || size == range.size() ? half : size;
  }
};

LightTree::LightTree(const std::vector<EmitterBounds>& emitters) {
  bit_trails_.assign(emitters.size(), kNotInTree);
  std::vector<uint32_t> range;
  for (size_t i = 0; i < emitters.size(); ++i) {
    if (emitters[i].power > 0) range.push_back(static_cast<uint32_t>(i));
  }
  if (range.empty()) return;
  nodes_.reserve(2 * range.size());
  Builder{emitters, &nodes_, &bit_trails_}.Build(range, 0, 0);
}

float LightTree::Importance(const Node& node, const LightReceiver& receiver) {
  const Vec3 offset = receiver.position - node.center;
  const float distance2 = LengthSquared(offset);
  const float radius2 = node.radius * node.radius;
  const float reach2 =
      std::max(distance2, radius2);  // near or inside the box the distance to its centre is meaningless
  if (reach2 <= 0) return node.power;
  const float inverse = 1.0f / std::sqrt(std::max(distance2, std::numeric_limits<float>::min()));
  // The cone of directions in which the box lies.
  const bool inside = distance2 <= radius2;
  const float sin_box = inside ? 0.0f : node.radius * inverse;
  const float cos_box = inside ? -1.0f : SineOf(sin_box);

  float cos_axis = Dot(node.axis, offset) * inverse;
  if (node.both_sides) cos_axis = std::abs(cos_axis);
  const float sin_axis = SineOf(cos_axis);
  const float cos_cone = CosineOfDifference(sin_axis, cos_axis, node.sin_spread, node.cos_spread);
  const float sin_cone = SineOfDifference(sin_axis, cos_axis, node.sin_spread, node.cos_spread);
  const float cos_emitted = CosineOfDifference(sin_cone, cos_cone, sin_box, cos_box);
  if (cos_emitted <= node.cos_falloff) return 0;

  const float cos_normal = std::abs(Dot(receiver.normal, offset)) * inverse;
  const float cos_received = CosineOfDifference(SineOf(cos_normal), cos_normal, sin_box, cos_box);
  return std::max(0.0f, node.power * cos_emitted * cos_received / reach2);
}

float LightTree::FirstShare(uint32_t index, const LightReceiver& receiver) const {
  const float first = Importance(nodes_[index + 1], receiver);
  const float sum = first + Importance(nodes_[nodes_[index].link], receiver);
  return sum > 0 ? first / sum : -1.0f;
}

LightTree::Choice LightTree::Pick(const LightReceiver& receiver, float u) const {
  Choice choice;
  if (nodes_.empty()) return choice;
  float probability = 1;
  uint32_t index = 0;
  while ((nodes_[index].link & kLeaf) == 0) {
    const uint32_t second = nodes_[index].link;
    const float share = FirstShare(index, receiver);
    if (share < 0) return choice;
    const bool go_first = u < share;
    u = std::min(go_first ? u / share : (u - share) / (1.0f - share), 0x1.fffffep-1f);
    probability *= go_first ? share : 1.0f - share;
    index = go_first ? index + 1 : second;
  }
  choice.emitter = nodes_[index].link & ~kLeaf;
  choice.probability = probability;
  return choice;
}

float LightTree::Probability(const LightReceiver& receiver, uint32_t emitter) const {
  uint64_t bit_trail = bit_trails_[emitter];
  if (bit_trail == kNotInTree) return 0;
  float probability = 1;
  uint32_t index = 0;
  while ((nodes_[index].link & kLeaf) == 0) {
    const uint32_t second = nodes_[index].link;
    const float share = FirstShare(index, receiver);
    if (share < 0) return 0;
    const bool go_first = (bit_trail & 1) == 0;
    bit_trail >>= 1;
    probability *= go_first ? share : 1.0f - share;
    index = go_first ? index + 1 : second;
  }
  return probability;
}

}  // namespace lumifold::render
