#pragma once

#include "worker/render/sampling/frame.h"

/// The GGX microfacet distribution with Smith's height-correlated masking. Directions are in the shading
/// frame (z = normal), both on the upper side; alpha is the squared perceptual roughness. Sources: Walter et
/// al. 2007; Heitz 2014 (masking); Heitz 2018 (sampling of visible normals).
namespace lumifold::render {

/// Below this alpha a lobe is a delta lobe: float directions do not resolve so narrow a highlight well.
inline constexpr float kDeltaAlpha = 1e-3f;

/// Below this difference of indices a rough boundary bends light by less than float resolves; it is treated
/// as smooth.
inline constexpr float kMinIorDifference = 0.01f;

/// Density of microfacet normals at h, per projected steradian.
float GgxDensity(Vec3 h, float alpha);

/// Height-correlated masking and shadowing over 4 cos_i cos_o: the "visibility" term V = G / (4 |wi.z|
/// |wo.z|).
float GgxVisibility(float cos_i, float cos_o, float alpha);

/// Height-correlated masking-shadowing of both directions over the masking of wo: the weight of a sampled
/// visible normal. Both cosines are positive; wi may lie on either side.
float GgxShadowing(float cos_i, float cos_o, float alpha);

/// Samples a microfacet normal visible from wo, with density GgxVisibleDensity(wo, h).
Vec3 SampleGgxVisibleNormal(Vec3 wo, float alpha, Vec2 u);

/// Density of SampleGgxVisibleNormal, per steradian of h.
float GgxVisibleDensity(Vec3 wo, Vec3 h, float alpha);

/// Schlick's approximation of the Fresnel reflectance; f0 and f90 are its values at normal and grazing
/// incidence.
inline Vec3 SchlickFresnel(Vec3 f0, Vec3 f90, float cos_theta) {
  const float m = cos_theta < 1.0f ? 1.0f - cos_theta : 0.0f;
  const float m2 = m * m;
  const float m5 = m2 * m2 * m;
  return f0 + (f90 - f0) * m5;
}

/// The exact Fresnel reflectance of unpolarised light. eta: index of the far side over that of the near side;
/// cos_i > 0 is on the near side. *cos_t receives the cosine of the refracted ray; under total internal
/// reflection it is 0 and the result is 1.
float DielectricFresnel(float cos_i, float eta, float* cos_t);

/// The half vector for refraction from wo to wi with index ratio eta, on wo's side; wi lies below.
inline Vec3 RefractionNormal(Vec3 wo, Vec3 wi, float eta) {
  const Vec3 h = wo + wi * eta;
  return Normalize(h.z < 0 ? -h : h);
}

/// The refraction of wo by a microfacet with normal h, with cos_t from DielectricFresnel.
inline Vec3 Refract(Vec3 wo, Vec3 h, float eta, float cos_t) {
  return h * (Dot(wo, h) / eta - cos_t) - wo * (1.0f / eta);
}

/// Jacobian of refraction, dh / dwi: the factor from a density of h to the density of wi.
/// Source: Walter et al. 2007, equation 17.
inline float RefractionJacobian(Vec3 wo, Vec3 wi, Vec3 h, float eta) {
  const float away = -Dot(wi, h);
  const float root = Dot(wo, h) - eta * away;
  return eta * eta * away / (root * root);
}

}  // namespace lumifold::render
