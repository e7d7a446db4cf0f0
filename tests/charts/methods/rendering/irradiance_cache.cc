#include "tests/charts/methods/rendering/irradiance_cache.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lumifold::charts {
namespace {

using scene::Vec3;

constexpr int kMostDepth = 20;

/// Largest distance of a point behind a record, over its radius; the record's surroundings are hidden beyond.
constexpr float kBehind = 0.01f;

Vec3 AtLeastZero(Vec3 v) { return {std::max(v.x, 0.0f), std::max(v.y, 0.0f), std::max(v.z, 0.0f)}; }

Vec3 OctantCorner(Vec3 corner, float half, int octant) {
  return {corner.x + ((octant & 1) != 0 ? half : 0), corner.y + ((octant & 2) != 0 ? half : 0),
          corner.z + ((octant & 4) != 0 ? half : 0)};
}

bool Touches(Vec3 centre, float reach, Vec3 corner, float side) {
  for (int axis = 0; axis < 3; ++axis) {
    if (centre[axis] + reach < corner[axis] || centre[axis] - reach > corner[axis] + side) return false;
  }
  return true;
}

}  // namespace

IrradianceCache::IrradianceCache(const scene::Bounds& bounds, float accuracy)
    : accuracy_(accuracy), nodes_(1) {
  if (bounds.IsEmpty()) return;
  corner_ = bounds.min;
  const float extent = MaxComponent(bounds.max - bounds.min);
  if (extent > 0) side_ = extent;
}

float IrradianceCache::Weight(const IrradianceRecord& record, Vec3 position, Vec3 normal,
                              float threshold) const {
  const Vec3 step = position - record.position;
  const float distance = Length(step);
  const float turn = std::max(0.0f, 1 - Dot(normal, record.normal));
  if (distance >= threshold * record.radius || turn >= threshold * threshold) return 0;
  if (Dot(step, normal + record.normal) * 0.5f <= -kBehind * record.radius) return 0;
  const float error = distance / record.radius + std::sqrt(turn);
  // Minus the weight at the limit, so that a record's influence ends continuously.
  constexpr float kLeastError = 1e-6f;
  return std::max(0.0f, 1 / std::max(error, kLeastError) - 1 / threshold);
}

std::optional<Vec3> IrradianceCache::Look(Vec3 position, Vec3 normal, float tolerance) const {
  const float threshold = accuracy_ * tolerance;
  Vec3 sum;
  float weights = 0;
  Vec3 corner = corner_;
  float side = side_;
  for (int node = 0; node >= 0;) {
    for (const uint32_t index : nodes_[static_cast<size_t>(node)].records) {
      const IrradianceRecord& record = records_[index];
      const float weight = Weight(record, position, normal, threshold);
      if (weight <= 0) continue;
      const Irradiance& known = record.irradiance;
      sum += (known.value + AlongStep(known.by_turn, normal - record.normal) +
              AlongStep(known.by_step, position - record.position)) *
             weight;
      weights += weight;
    }
    side *= 0.5f;
    const int octant = (position.x >= corner.x + side ? 1 : 0) | (position.y >= corner.y + side ? 2 : 0) |
                       (position.z >= corner.z + side ? 4 : 0);
    corner = OctantCorner(corner, side, octant);
    node = nodes_[static_cast<size_t>(node)].children[static_cast<size_t>(octant)];
  }
  if (weights <= 0) return std::nullopt;
  return AtLeastZero(sum * (1 / weights));
}

void IrradianceCache::ClampByNeighbours(IrradianceRecord* record) {
  for (const IrradianceRecord& other : records_) {
    record->radius = std::min(record->radius, other.radius + Length(other.position - record->position));
  }
  record->radius = std::max(record->radius, record->least_radius);
  for (IrradianceRecord& other : records_) {
    const float reach = record->radius + Length(other.position - record->position);
    other.radius = std::max(other.least_radius, std::min(other.radius, reach));
  }
}

void IrradianceCache::Insert(IrradianceRecord record) {
  ClampByNeighbours(&record);
  records_.push_back(record);
  Store(static_cast<uint32_t>(records_.size() - 1), 0, corner_, side_, 0);
}

void IrradianceCache::Store(uint32_t index, int node, Vec3 corner, float side, int depth) {
  const IrradianceRecord& record = records_[index];
  const float reach = record.radius * accuracy_ * kMostTolerance;
  if (depth == kMostDepth || side < 4 * reach) {
    nodes_[static_cast<size_t>(node)].records.push_back(index);
    return;
  }
  const float half = side * 0.5f;
  for (int octant = 0; octant < 8; ++octant) {
    const Vec3 child_corner = OctantCorner(corner, half, octant);
    if (Touches(record.position, reach, child_corner, half))
      Store(index, ChildOf(node, octant), child_corner, half, depth + 1);
  }
}

int IrradianceCache::ChildOf(int node, int octant) {
  const int child = nodes_[static_cast<size_t>(node)].children[static_cast<size_t>(octant)];
  if (child >= 0) return child;
  nodes_.emplace_back();
  const int added = static_cast<int>(nodes_.size()) - 1;
  nodes_[static_cast<size_t>(node)].children[static_cast<size_t>(octant)] = added;
  return added;
}

}  // namespace lumifold::charts
