#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "tests/charts/methods/rendering/irradiance.h"
#include "worker/scene/scene.h"

namespace lumifold::charts {

/// Irradiance that was gathered at one place and stands for the places around it.
struct IrradianceRecord {
  scene::Vec3 position;
  scene::Vec3 normal;
  Irradiance irradiance;
  float radius = 0;        // metres: the error grows with the distance over it
  float least_radius = 0;  // below which no neighbour may bring it
};

/// Irradiances in the scene, looked up and interpolated. Source: Ward, Rubinstein & Clear 1988 (split-sphere
/// weights); Ward & Heckbert 1992 (gradients); Krivanek et al. 2006 (neighbour clamping). Threads: Look() is
/// safe concurrently while nobody calls Insert(). What it gives depends on the order of insertions.
class IrradianceCache {
 public:
  /// `bounds` holds all places that will be asked for; `accuracy` is Ward's a: records are used up to about
  /// that share of their radius away.
  IrradianceCache(const scene::Bounds& bounds, float accuracy);

  /// The irradiance at a place, at least 0; none where no record is near enough. `tolerance` multiplies
  /// `accuracy`, and must be at most kMostTolerance.
  std::optional<scene::Vec3> Look(scene::Vec3 position, scene::Vec3 normal, float tolerance) const;
  static constexpr float kMostTolerance = 2;

  /// Its radius is clamped by its neighbours' and theirs by its own: a step towards a record must not reach
  /// farther than the record itself does.
  void Insert(IrradianceRecord record);

  size_t size() const { return records_.size(); }

 private:
  /// A cube of an octree: what it holds reaches about as far as the cube is wide.
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
