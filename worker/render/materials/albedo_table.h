#pragma once

#include <array>
#include <vector>

#include "worker/render/materials/microfacet.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// Directional albedo of the GGX lobe with Schlick's Fresnel: albedo = f0 * scale + f90 * bias.
struct DirectionalAlbedo {
  float scale = 0;
  float bias = 0;
};

/// Tables of directional albedos over cosine and roughness: single scattering, integrated by quadrature.
/// Threads: safe concurrently after construction.
class AlbedoTable {
 public:
  /// The optional tables.
  struct Contents {
    bool reflection = true;    // GGX with Schlick's Fresnel: Lookup() and Average()
    bool anisotropic = false;  // the same for anisotropic GGX
    bool sheen = false;
    std::vector<float> glass_iors = {};  // of solid glass, ascending
  };
  AlbedoTable() : AlbedoTable(Contents{}) {}
  explicit AlbedoTable(const Contents& contents);

  /// What Lookup() interpolates: scale and bias of kSize cosines for each of kSize roughnesses.
  const float* Nodes() const { return &table_[0][0].scale; }

  /// cos_o in [0, 1], alpha in [0, 1].
  DirectionalAlbedo Lookup(float cos_o, float alpha) const;
  /// wo is unit, in the shading frame. If alpha is anisotropic, Contents::anisotropic must be set, and
  /// alpha.x be the greater one.
  DirectionalAlbedo Lookup(Vec3 wo, GgxAlpha alpha) const {
    return alpha.IsIsotropic() ? Lookup(wo.z, alpha.x) : LookupAnisotropic(wo, alpha);
  }
  /// The cosine-weighted mean of Lookup over the hemisphere.
  DirectionalAlbedo Average(float alpha) const;

  /// Directional albedo of SheenLobe; Contents::sheen must be set.
  float Sheen(float cos_o, float alpha) const;

  /// Directional albedo of a rough boundary of solid glass, reflection plus refraction, seen from outside or
  /// inside. Interpolated between Contents::glass_iors, which must not be empty.
  float Glass(float ior, bool inside, float cos_o, float alpha) const;

 private:
  static constexpr int kSize = 32;
  static constexpr int kSmallSize = 24;
  using SmallTable = std::array<std::array<float, kSmallSize>, kSmallSize>;  // [roughness][cosine]

  void BuildReflection();
  void BuildAnisotropic();
  DirectionalAlbedo LookupAnisotropic(Vec3 wo, GgxAlpha alpha) const;

  DirectionalAlbedo table_[kSize][kSize];  // [roughness][cosine]
  DirectionalAlbedo average_[kSize];
  std::vector<DirectionalAlbedo> anisotropic_;  // by strength, roughness, azimuth and cosine; or empty
  std::vector<float> glass_iors_;
  std::vector<SmallTable> glass_;  // two for each ior: from outside, from inside
  std::vector<SmallTable> sheen_;  // one or none
};

/// The tables that the scene's materials need.
AlbedoTable::Contents AlbedoContentsOf(const scene::Scene& scene);

}  // namespace lumifold::render
