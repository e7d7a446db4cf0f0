#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tests/charts/methods/rendering/irradiance.h"
#include "worker/scene/scene.h"

namespace lumifold::charts {

/// Irradiance at one point, used for the points around it.
struct IrradianceRecord {
  scene::Vec3 position;
  scene::Vec3 normal;
  Irradiance irradiance;
  float radius = 0;        // metres: the error is proportional to distance / radius
  float least_radius = 0;  // lower bound for the clamping by neighbours
};

/// Cache of irradiance records in the scene, with interpolation. The result depends on the order of
/// insertions.
/// Threads: Look() is safe concurrently while no thread calls Insert().
/// Source:  Ward, Rubinstein & Clear 1988 (split-sphere weights); Ward & Heckbert 1992 (gradients); Krivanek
///          et al. 2006 (neighbour clamping).
class IrradianceCache {
 public:
  /// `bounds` contains all points of later calls. `accuracy` is Ward's a: a record is used up to about that
  /// fraction of its radius away.
  IrradianceCache(const scene::Bounds& bounds, float accuracy);

  /// The irradiance at a point, at least 0; nothing if no record is near enough. `tolerance` multiplies
  /// `accuracy` and is at most kMostTolerance.
  std::optional<scene::Vec3> Look(scene::Vec3 position, scene::Vec3 normal, float tolerance) const;
  static constexpr float kMostTolerance = 2;

  /// Clamps the radii of the record and its neighbours by each other: a radius exceeds a neighbour's by at
  /// most their distance.
  void Insert(IrradianceRecord record);

  size_t size() const { return records_.size(); }

 private:
  /// A cube of an octree, whose records have a radius of about its width.
  struct Node {
    std::array<int, 8> children = {-1, -1, -1, -1, -1, -1, -1, -1};
    std::vector<uint32_t> records;
  };

  float Weight(const IrradianceRecord& record, scene::Vec3 position, scene::Vec3 normal,
               float threshold) const;
  void ClampByNeighbours(IrradianceRecord* record);
  void Store(uint32_t index, int node, scene::Vec3 corner, float side, int depth);
  int ChildOf(int node, int octant);

  float accuracy_;
  scene::Vec3 corner_;
  float side_ = 1;
  std::vector<IrradianceRecord> records_;
  std::vector<Node> nodes_;
};

}  // namespace lumifold::charts
