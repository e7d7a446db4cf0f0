#include "worker/render/lights/light_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>

#include "filter/image/portable_math.h"
#include "worker/render/sampling/frame.h"

namespace lumifold::render {
namespace one {

#include "worker/render/lights/importance-inl.h"

}  // namespace one

namespace {

using scene::Bounds;
using scene::Vec3;

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

/// Bounds of the union of two groups; a group of intensity 0 is ignored.
void Include(const EmitterBounds& b, EmitterBounds* a) {
  if (b.intensity <= 0) return;
  if (a->intensity <= 0) {
    *a = b;
    return;
  }
  Include(b.box, &a->box);
  a->intensity += b.intensity;
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
  if (b.intensity <= 0) return 0;
  return b.intensity * OrientationMeasure(b) * static_cast<double>(LengthSquared(b.box.max - b.box.min));
}

/// Inline in LightLeaf::Weigh(), whose loop becomes vectors.
inline float ImportanceOf(const LightExtent& extent, const LightReceiver& receiver) {
  return one::Importance(extent, receiver.position, receiver.normal, receiver.transmits ? -1.0f : 1.0f);
}

}  // namespace

/// Builds the nodes in depth-first order.
struct LightTree::Builder {
  std::span<const EmitterBounds> emitters;
  LightTree* tree;

  EmitterBounds BoundsOf(std::span<const uint32_t> range) const {
    EmitterBounds all;
    for (const uint32_t i : range) Include(emitters[i], &all);
    return all;
  }

  void Build(std::span<uint32_t> range, uint64_t bit_trail, int depth) {
    std::vector<Node>& nodes = tree->nodes_;
    const size_t index = nodes.size();
    nodes.push_back({ExtentOf(BoundsOf(range))});
    if (range.size() <= LightLeaf::kSize) {
      nodes[index].link = kLeaf | static_cast<uint32_t>(tree->leaves_.size());
      MakeLeaf(range, bit_trail);
      return;
    }
    const size_t middle = Split(range, depth);
    Build(range.first(middle), bit_trail, depth + 1);
    nodes[index].link = static_cast<uint32_t>(nodes.size());
    Build(range.subspan(middle), bit_trail | uint64_t{1} << depth, depth + 1);
  }

  void MakeLeaf(std::span<const uint32_t> range, uint64_t bit_trail) {
    LightLeaf& leaf = tree->leaves_.emplace_back();
    for (const uint32_t i : range) {
      tree->places_[i] = {bit_trail, static_cast<int>(leaf.count)};
      leaf.Add(ExtentOf(emitters[i]), i);
    }
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
  places_.resize(emitters.size());
  std::vector<uint32_t> range;
  for (size_t i = 0; i < emitters.size(); ++i) {
    if (emitters[i].intensity > 0) range.push_back(static_cast<uint32_t>(i));
  }
  if (!range.empty()) Builder{emitters, this}.Build(range, 0, 0);
}

LightExtent LightTree::ExtentOf(const EmitterBounds& bounds) {
  LightExtent extent;
  extent.center = CenterOf(bounds.box);
  extent.radius = 0.5f * Length(bounds.box.max - bounds.box.min);
  extent.axis = bounds.axis;
  SinCos(bounds.spread, &extent.sin_spread, &extent.cos_spread);
  float unused = 0;
  SinCos(bounds.falloff, &unused, &extent.cos_falloff);
  extent.intensity = static_cast<float>(bounds.intensity);
  extent.both_sides = bounds.both_sides ? 1.0f : 0.0f;
  return extent;
}

void LightLeaf::Add(const LightExtent& extent, uint32_t emitter) {
  x[count] = extent.center.x;
  y[count] = extent.center.y;
  z[count] = extent.center.z;
  radius[count] = extent.radius;
  axis_x[count] = extent.axis.x;
  axis_y[count] = extent.axis.y;
  axis_z[count] = extent.axis.z;
  cos_spread[count] = extent.cos_spread;
  sin_spread[count] = extent.sin_spread;
  cos_falloff[count] = extent.cos_falloff;
  intensity[count] = extent.intensity;
  both_sides[count] = extent.both_sides;
  emitters[count++] = emitter;
}

LightLeaf::Weights LightLeaf::Weigh(LightReceiver receiver) const {
  Weights weights;
  if (count == 1) {  // whatever it is worth
    weights.of[0] = weights.sum = 1;
    return weights;
  }
  constexpr size_t kVector = 4;
  const size_t end = (count + kVector - 1) / kVector * kVector;
  Row row = {};  // a local: to store in it changes none of the numbers that are read
  for (size_t i = 0; i < end; ++i) {
    row[i] = ImportanceOf(At(i), receiver);
  }
  weights.of = row;
  weights.sum = 0;
  for (size_t i = 0; i < count; ++i) weights.sum += row[i];
  return weights;
}

float LightTree::FirstShare(uint32_t index, const LightReceiver& receiver) const {
  const float first = ImportanceOf(nodes_[index + 1].extent, receiver);
  const float sum = first + ImportanceOf(nodes_[nodes_[index].link].extent, receiver);
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
  const LightLeaf& leaf = leaves_[nodes_[index].link & ~kLeaf];
  const LightLeaf::Weights weights = leaf.Weigh(receiver);
  if (weights.sum <= 0) return choice;
  float left = u * weights.sum;
  size_t picked = 0;
  for (size_t i = 0; i < leaf.count && left >= 0; ++i) {
    if (weights.of[i] > 0) picked = i;  // the last one, should rounding leave more than there is
    left -= weights.of[i];
  }
  choice.emitter = leaf.emitters[picked];
  choice.probability = probability * (weights.of[picked] / weights.sum);
  return choice;
}

float LightTree::Probability(const LightReceiver& receiver, uint32_t emitter) const {
  const Place& place = places_[emitter];
  if (place.slot < 0) return 0;
  uint64_t bit_trail = place.bit_trail;
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
  const LightLeaf::Weights weights = leaves_[nodes_[index].link & ~kLeaf].Weigh(receiver);
  return weights.sum > 0 ? probability * (weights.of[static_cast<size_t>(place.slot)] / weights.sum) : 0.0f;
}

}  // namespace lumifold::render
