#pragma once

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"
#include "worker/render/materials/bsdf.h"

namespace lumifold::render {

/// A direction above the surface, in proportion to its cosine.
inline Vec3 CosineDirection(Vec2 u) {
  const Vec2 disk = ConcentricDisk(u);
  return {disk.x, disk.y, std::sqrt(std::max(0.0f, 1.0f - disk.x * disk.x - disk.y * disk.y))};
}

/// The diffuse lobe alone: what Bsdf is for a material with SurfaceMaterial::IsDiffuseOnly().
class DiffuseBsdf {
 public:
  DiffuseBsdf(Vec3 albedo, Vec3 normal, Vec3 geometric)
      : albedo_(albedo), normal_(normal), geometric_(geometric) {}

  bool HasDiffuse() const { return MaxComponent(albedo_) > 0; }

  /// Bsdf::Evaluate.
  BsdfValue Evaluate(Vec3 wi, float* pdf) const {
    BsdfValue value;
    *pdf = 0;
    if (!HasDiffuse()) return value;
    const float cos_i = Dot(wi, normal_);
    *pdf = cos_i > 0 && Dot(wi, geometric_) > 0 ? cos_i / kPi : 0.0f;
    value.diffuse = *pdf;
    return value;
  }

  /// Bsdf::Sample: in proportion to the lobe, so the weight is 1.
  BsdfSample Sample(float /*u_lobe*/, Vec2 u) const {
    BsdfSample sample;
    if (!HasDiffuse()) return sample;
    const Vec3 wi = CosineDirection(u);
    sample.wi = Frame(normal_).ToWorld(wi);
    if (wi.z <= 0 || Dot(sample.wi, geometric_) <= 0) return sample;
    sample.pdf = wi.z / kPi;
    sample.weight.diffuse = 1;
    sample.valid = true;
    return sample;
  }

 private:
  Vec3 albedo_;
  Vec3 normal_;
  Vec3 geometric_;
};

}  // namespace lumifold::render
