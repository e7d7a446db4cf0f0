#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "worker/render/lights/lights.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/sampling/sobol_lanes.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// The cone of a scattered ray covers about this share of the solid angle over the density of its direction,
/// so that after diffuse scattering (density at most 1/pi) it opens by at least a sixth of a radian: narrow
/// enough to resolve textures nearby, wide enough to read distant ones from few texels.
inline constexpr float kConeShareOfDensity = 0.1f;

struct LaneVec {
  LaneRow x, y, z;

  void Set(size_t lane, scene::Vec3 v) {
    x[lane] = v.x;
    y[lane] = v.y;
    z[lane] = v.z;
  }
  scene::Vec3 At(size_t lane) const { return {x[lane], y[lane], z[lane]}; }
};

/// The random numbers of a vertex: its pairs of dimensions in the order of PathSampler.
struct RandomLanes {
  static constexpr size_t kPairs = 3;
  // See Sampler::Seeds.
  LaneBits reversed_index;
  std::array<LaneBits, kPairs> shuffle, scramble;
  // The numbers.
  LanePair light_and_lobe, light_point, direction;

  /// Draws the numbers of the first `count` paths.
  void Draw(size_t count) {
    DrawPairs(reversed_index, shuffle[0], scramble[0], count, &light_and_lobe);
    DrawPairs(reversed_index, shuffle[1], scramble[1], count, &light_point);
    DrawPairs(reversed_index, shuffle[2], scramble[2], count, &direction);
  }
};

// Records that lanes read and write four numbers at a time: where the fourth has no name, it has no meaning.

/// A ray with its cone; see Ray. It begins as Embree's rays do.
struct RayRecord {
  Vec3 origin;
  float min_distance = 0;
  Vec3 direction;  // unit
  float time = 0;  // of the camera ray whose path this is: from 0 to 1 while the shutter is open
  float max_distance = std::numeric_limits<float>::infinity();
  float width = 0;   // metres: width of the ray's cone at its origin, for textures
  float spread = 0;  // growth of the cone's width per metre; both 0: a line
  float unused = 0;
};

/// What scattering needs of a surface; see Surface.
struct SurfaceRecord {
  Vec3 position;
  float epsilon = 0;      // distance from the face at which a new ray must start so as not to hit it again
  Vec3 normal;            // unit shading normal, normal map included, on the side the ray came from
  float cone_width = 0;   // width of the ray's cone here; 0 if the scene has no textures
  Vec3 geometric;         // unit face normal on the same side
  float cone_spread = 0;  // growth of that width per metre
};

/// What a path has become by its vertices; see Path.
struct PathRecord {
  Vec3 throughput = {1, 1, 1};  // since its part began
  float pdf = 0;            // with which the direction was sampled at the last vertex; 0 for a delta event
  Vec3 before = {1, 1, 1};  // throughput up to there, what the camera's surface scatters left out
  float unused = 0;
};

/// A light sample at a vertex; see Connection.
struct ConnectionRecord {
  BsdfValue value;
  Vec3 factor;        // of `light`: the value of all lobes, times the throughput where `is_seen` is 0
  float is_seen = 0;  // 1: the vertex is a surface whose lobes are kept apart
  Vec3 light;         // incident radiance over its density, MIS-weighted; black: no light was sampled
  float unused = 0;
};

/// What becomes of a surface whose lobes are kept apart; see SeenSurface.
struct SeenRecord {
  Vec3 diffuse_albedo;
  float has_diffuse = 0;  // 1: it has that lobe
  Vec3 glossy_albedo;
  float has_facets = 0;
  BsdfValue weight;  // of the step
  Vec3 total_weight;
  float unused = 0;
};

/// Where the numbers of a vertex are.
struct LaneVertex {
  const SurfaceRecord* surface = nullptr;
  const BaseMaterial* material = nullptr;
  const LightTriangle* triangle = nullptr;  // that was picked as the light
  RayRecord* ray = nullptr;                 // that arrives = nullptr; becomes the one that leaves
  PathRecord* path = nullptr;
  ConnectionRecord* connection = nullptr;
  RayRecord* shadow_ray = nullptr;
};

/// Numbers of the vertices that are in no record.
struct ChoiceLanes {
  LaneRow slot;         // of the picked light in its leaf
  LaneRow probability;  // of that light; then, of the triangle
  LaneRow is_seen;      // 1: the surface's lobes are kept apart
  LaneRow roulette;     // see RouletteFactor()
};

/// Samples of lights that are no triangles, where `is_sampled` is 1; see LightSample.
struct LightLanes {
  LaneVec radiance, direction;
  LaneRow is_sampled, pdf, distance, is_delta;
};

/// The vertices of some paths before they are shaded. Those of all lanes must be set.
struct alignas(64) VertexLanes {
  std::array<LaneVertex, kMaxLanes> vertices;
  RandomLanes random;
  ChoiceLanes choice;
  LightLanes light;
};

/// What becomes of them besides what is in their records.
struct alignas(64) ShadedLanes {
  LaneRow goes_on;  // 1: the path does
  std::array<SeenRecord, kMaxLanes> seen;
};

/// Shades the first `count` paths, whose surfaces have a diffuse lobe, rough reflection, or both, and no
/// other: samples the light and the next direction. `albedos` is AlbedoTable::Nodes(). Whole vectors are read
/// and written. The result of a path has the bits that Bsdf, LightSet and PathTracer compute for it alone,
/// whatever the instruction set and the other paths.
void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out);

}  // namespace lumifold::render
