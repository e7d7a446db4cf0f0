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

/// What is known of the vertices of some paths before they are shaded. Rows are indexed by path.
struct alignas(64) VertexLanes {
  // The surface; see Surface.
  LaneVec position, normal, geometric, to_viewer;
  LaneRow epsilon;
  // The material; see BaseMaterial.
  LaneVec base_color, f0;
  LaneRow f90, metallic, base_weight, alpha, root_alpha, dielectric_f0, dielectric_f90, mean_albedo;
  // The path: its throughput, and Russian roulette, see Roulette::Survival.
  LaneVec throughput;
  LaneRow roulette_scale, roulette_unit;  // whose product times the throughput it survives; 0: it goes on
  RandomLanes random;
  // The light that was picked: a triangle.
  LaneVec corner, edge1, edge2, light_normal, radiance;
  LaneRow inverse_area, probability, both_sides;
  // Or, where `is_sampled` is 1, a light sample; see LightSample. Its radiance is in `radiance`.
  LaneVec light_direction;
  LaneRow is_sampled, light_pdf, light_distance, is_delta;
};

/// What becomes of them.
struct alignas(64) ShadedLanes {
  LaneVec diffuse_albedo, glossy_albedo;
  LaneRow has_diffuse, estimate, has_facets;
  // The light sample; light is 0 where there is none.
  LaneVec light, non_diffuse, shadow_origin, shadow_direction;
  LaneRow diffuse, shadow_distance;
  // The next step; `survival` is 0 where the path ends, and pdf is 0 where no direction was found.
  LaneVec direction, step_non_diffuse;
  LaneRow survival, step_diffuse, pdf;
};

/// Draws the numbers of the first `count` paths: those of Sampler::Get2D.
void DrawLanes(RandomLanes* random, size_t count);

/// Shades the first `count` paths, whose surfaces have a diffuse lobe, rough reflection, or both, and no
/// other. `albedos` is AlbedoTable::Nodes(). Whole vectors are read and written: what lies behind `count` has
/// no meaning. The result of a path has the bits that Bsdf, LightSet and PathTracer compute for it alone,
/// whatever the instruction set and the other paths.
void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out);

}  // namespace lumifold::render
