#pragma once

#include <array>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// How much light the GGX lobe sends on in all directions, as a function of the viewing angle: with Schlick's
/// Fresnel, albedo = f0 * scale + f90 * bias.
struct DirectionalAlbedo {
  float scale = 0;
  float bias = 0;
};

/// Tables how much light the lobes send on in all directions, over cosine and roughness: single scattering,
/// by quadrature. Built once, read by all threads.
class AlbedoTable {
 public:
  /// What is tabled beside GGX with Schlick's Fresnel, which everything needs.
  struct Contents {
    bool sheen = false;
    std::vector<float> glass_iors;  // of solid glass, ascending
  };
  AlbedoTable() : AlbedoTable(Contents{}) {}
  explicit AlbedoTable(const Contents& contents);

  /// cos_o in [0, 1], alpha in [0, 1].
  DirectionalAlbedo Lookup(float cos_o, float alpha) const;
  /// The cosine-weighted mean of Lookup over the hemisphere.
  DirectionalAlbedo Average(float alpha) const;

  /// Of SheenLobe; the contents must have it.
  float Sheen(float cos_o, float alpha) const;

  /// Of a rough boundary of solid glass, reflection and refraction together, seen from the outside or the
  /// inside; between the contents' iors, of which there must be one, by interpolation.
  float Glass(float ior, bool inside, float cos_o, float alpha) const;

 private:
  static constexpr int kSize = 32;
  static constexpr int kSmallSize = 24;
  using SmallTable = std::array<std::array<float, kSmallSize>, kSmallSize>;  // [roughness][cosine]

  void BuildReflection();

  DirectionalAlbedo table_[kSize][kSize];  // [roughness][cosine]
  DirectionalAlbedo average_[kSize];
  std::vector<float> glass_iors_;
  std::vector<SmallTable> glass_;  // two an ior: from the outside, from the inside
  std::vector<SmallTable> sheen_;  // one or none
};

/// What the scene's materials need.
AlbedoTable::Contents AlbedosOf(const scene::Scene& scene);

}  // namespace lumifold::render
