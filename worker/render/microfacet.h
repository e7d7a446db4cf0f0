#pragma once

#include "worker/render/frame.h"

/// The GGX distribution of microfacets with Smith's height-correlated masking. Directions are in the shading
/// frame (z = normal), both on the upper side; alpha is the squared perceptual roughness. Sources: Walter et
/// al. 2007; Heitz 2014 (masking); Heitz 2018 (sampling of visible normals).
namespace lumifold::render {

/// Below this alpha a lobe is a perfect mirror: the highlight is narrower than float directions resolve well.
inline constexpr float kDeltaAlpha = 1e-3f;

/// Density of microfacet normals at h, per projected steradian.
float GgxDensity(Vec3 h, float alpha);

/// Height-correlated masking and shadowing over 4 cos_i cos_o: the "visibility" term V = G / (4 |wi.z|
/// |wo.z|).
float GgxVisibility(float cos_i, float cos_o, float alpha);

/// A microfacet normal seen from wo, with probability density GgxVisibleDensity(wo, h).
Vec3 SampleGgxVisibleNormal(Vec3 wo, float alpha, Vec2 u);

/// Density of SampleGgxVisibleNormal, per steradian of h.
float GgxVisibleDensity(Vec3 wo, Vec3 h, float alpha);

/// Schlick's approximation of the Fresnel reflectance, from its value at normal incidence; 1 at grazing.
inline Vec3 SchlickFresnel(Vec3 f0, float cos_theta) {
  const float m = cos_theta < 1.0f ? 1.0f - cos_theta : 0.0f;
  const float m2 = m * m;
  const float m5 = m2 * m2 * m;
  return f0 + (Vec3{1, 1, 1} - f0) * m5;
}

/// The exact Fresnel reflectance of unpolarised light; eta = index of the far side over that of the near
/// side; cos_i > 0 on the near side. Sets *cos_t to the cosine of the refracted ray, 0 under total reflection
/// (then the result is 1).
float DielectricFresnel(float cos_i, float eta, float* cos_t);

/// How much light the lobe sends on in all directions, as a function of the viewing angle: albedo(f0) = f0 *
/// scale + bias.
struct DirectionalAlbedo {
  float scale = 0;
  float bias = 0;
};

/// Tables the directional albedo of the GGX lobe with Schlick's Fresnel over cosine and roughness. Built
/// once, read by all threads.
class AlbedoTable {
 public:
  AlbedoTable();
  /// cos_o in [0, 1], alpha in [0, 1].
  DirectionalAlbedo Lookup(float cos_o, float alpha) const;
  /// The cosine-weighted mean of Lookup over the hemisphere.
  DirectionalAlbedo Average(float alpha) const;

 private:
  static constexpr int kSize = 32;
  DirectionalAlbedo table_[kSize][kSize];  // [roughness][cosine]
  DirectionalAlbedo average_[kSize];
};

}  // namespace lumifold::render
