#pragma once

#include <cmath>

#include "filter/image/portable_math.h"
#include "worker/render/sampling/frame.h"

/// Scattering by microfacets; see ggx-inl.h. Directions are unit, in the shading frame (z = normal), both
/// on the upper side.
namespace lumifold::render {

/// Below this alpha a lobe is a delta lobe: float directions do not resolve so narrow a highlight well.
inline constexpr float kDeltaAlpha = 1e-3f;

/// Below this difference of indices a rough boundary bends light by less than float resolves; it is treated
/// as smooth.
inline constexpr float kMinIorDifference = 0.01f;

/// Squared perceptual roughness along the x and y axes of the shading frame.
struct GgxAlpha {
  float x = 1;
  float y = 1;

  constexpr GgxAlpha() = default;
  constexpr explicit GgxAlpha(float isotropic) : x(isotropic), y(isotropic) {}
  constexpr GgxAlpha(float along_x, float along_y) : x(along_x), y(along_y) {}

  bool IsIsotropic() const { return x == y; }
  /// Of an isotropic distribution that is about as wide.
  float Mean() const { return IsIsotropic() ? x : std::sqrt(0.5f * (x * x + y * y)); }
};

inline float Product(GgxAlpha alpha) { return alpha.x * alpha.y; }
/// The square of the alpha in the plane of the normal and w, which masking towards w depends on.
inline float SquaredTowards(GgxAlpha alpha, Vec3 w) {
  const float sine2 = w.x * w.x + w.y * w.y;
  if (alpha.IsIsotropic() || sine2 <= 0) return Product(alpha);
  return (alpha.x * alpha.x * w.x * w.x + alpha.y * alpha.y * w.y * w.y) / sine2;
}
inline Vec3 Stretched(Vec3 v, GgxAlpha alpha) { return {alpha.x * v.x, alpha.y * v.y, v.z}; }
inline Vec2 EllipseSquares(Vec3 h, GgxAlpha alpha) {
  const float ratio = alpha.y / alpha.x;
  return {ratio * h.x * h.x, h.y * h.y / ratio};
}

namespace one {
#include "worker/render/materials/ggx-inl.h"
}  // namespace one

using one::GgxDensity;
using one::GgxVisibility;
using one::GgxVisibleDensity;
using one::MetalGain;
using one::MirrorDirection;
using one::SampleGgxVisibleNormal;
using one::SchlickFresnel;

/// Height-correlated masking-shadowing of both directions over the masking of wo: the weight of a sampled
/// visible normal. wi may lie on either side.
float GgxShadowing(Vec3 wi, Vec3 wo, GgxAlpha alpha);

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
