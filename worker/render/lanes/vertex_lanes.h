#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "worker/scene/vec.h"

namespace lumifold::render {

/// Most paths that are shaded side by side.
inline constexpr size_t kMaxLanes = 16;

/// A number of each path.
using LaneRow = std::array<float, kMaxLanes>;

struct LaneVec {
  LaneRow x, y, z;

  void Set(size_t lane, scene::Vec3 v) {
    x[lane] = v.x;
    y[lane] = v.y;
    z[lane] = v.z;
  }
  scene::Vec3 At(size_t lane) const { return {x[lane], y[lane], z[lane]}; }
};

/// Two random numbers in [0, 1) of each path.
struct LanePair {
  LaneRow x, y;

  scene::Vec2 At(size_t lane) const { return {x[lane], y[lane]}; }
};

/// The random numbers of a vertex: its pairs of dimensions in the order of PathSampler.
struct RandomLanes {
  static constexpr size_t kPairs = 3;
  using Bits = std::array<uint32_t, kMaxLanes>;

  // See Sampler::Seeds.
  Bits reversed_index;
  std::array<Bits, kPairs> shuffle, scramble;
  // The numbers.
  LanePair light_and_lobe, light_point, direction;
};

/// See Surface.
struct SurfaceLanes {
  LaneVec position, normal, geometric, to_viewer;
  LaneRow epsilon;
};

/// See BaseMaterial.
struct MaterialLanes {
  LaneVec base_color, f0;
  LaneRow f90, metallic, base_weight, alpha, root_alpha, dielectric_f0, dielectric_f90, mean_albedo;
};

/// A path's throughput, and Russian roulette, see Roulette::Survival.
struct ThroughputLanes {
  LaneVec throughput;
  LaneRow scale, unit;  // whose product times the throughput it survives; 0: it goes on
};

/// A triangle that was picked as the light; see LightTriangle.
struct TriangleLanes {
  LaneVec corner, edge1, edge2, normal;
  LaneRow inverse_area, probability, both_sides;
};

/// The light, and where `is_sampled` is 1 the sample of it, which then is no triangle's; see LightSample.
struct LightLanes {
  LaneVec radiance, direction;
  LaneRow is_sampled, pdf, distance, is_delta;
};

/// What is known of the vertices of some paths before they are shaded. Rows are indexed by path.
struct alignas(64) VertexLanes {
  SurfaceLanes surface;
  MaterialLanes material;
  ThroughputLanes path;
  RandomLanes random;
  TriangleLanes triangle;
  LightLanes light;
};

/// A light sample with its shadow ray; light is 0 where there is none. See Connection.
struct ConnectionLanes {
  LaneVec light, non_diffuse, origin, direction;
  LaneRow diffuse, distance;
};

/// The next step; `survival` is 0 where the path ends, and pdf is 0 where no direction was found.
struct StepLanes {
  LaneVec direction, non_diffuse;
  LaneRow survival, diffuse, pdf;
};

/// What becomes of them.
struct alignas(64) ShadedLanes {
  LaneVec diffuse_albedo, glossy_albedo;
  LaneRow has_diffuse, has_facets, estimate;  // see Path::estimate
  ConnectionLanes connection;
  StepLanes step;
};

/// Draws the numbers of the first `count` paths: those of Sampler::Get2D.
void DrawLanes(RandomLanes* random, size_t count);

/// Shades the first `count` paths, whose surfaces have a diffuse lobe, rough reflection, or both, and no
/// other. `albedos` is AlbedoTable::Nodes(). Whole vectors are read and written: what lies behind `count` has
/// no meaning. The result of a path has the bits that Bsdf, LightSet and PathTracer compute for it alone,
/// whatever the instruction set and the other paths.
void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out);

}  // namespace lumifold::render
