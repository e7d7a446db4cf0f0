#include "worker/render/materials/microfacet.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {

float GgxDensity(Vec3 h, GgxAlpha alpha) {
  const float a2 = alpha.x * alpha.y;
  const float ratio = alpha.y / alpha.x;
  // The textbook form cos^2 (a2 - 1) + 1 suffers from cancellation at small alpha; this form does not.
  const float t = a2 * h.z * h.z + ratio * h.x * h.x + h.y * h.y / ratio;
  return a2 / (kPi * t * t);
}

float GgxVisibility(Vec3 wi, Vec3 wo, GgxAlpha alpha) {
  const float a2_o = alpha.SquaredTowards(wo);
  const float a2_i = alpha.SquaredTowards(wi);
  const float lambda_o = wi.z * std::sqrt(wo.z * wo.z * (1.0f - a2_o) + a2_o);
  const float lambda_i = wo.z * std::sqrt(wi.z * wi.z * (1.0f - a2_i) + a2_i);
  return 0.5f / (lambda_o + lambda_i);
}

float GgxShadowing(Vec3 wi, Vec3 wo, GgxAlpha alpha) {
  const float a2_o = alpha.SquaredTowards(wo);
  const float a2_i = alpha.SquaredTowards(wi);
  const float cos_i = std::abs(wi.z);
  const float root_o = std::sqrt(wo.z * wo.z * (1.0f - a2_o) + a2_o);
  const float root_i = std::sqrt(cos_i * cos_i * (1.0f - a2_i) + a2_i);
  return cos_i * (wo.z + root_o) / (cos_i * root_o + wo.z * root_i);
}

Vec3 SampleGgxVisibleNormal(Vec3 wo, GgxAlpha alpha, Vec2 u) {
  const Vec3 stretched = Normalize(Vec3{alpha.x * wo.x, alpha.y * wo.y, wo.z});
  const float length2 = stretched.x * stretched.x + stretched.y * stretched.y;
  const Vec3 t1 = length2 > 0 ? Vec3{-stretched.y, stretched.x, 0} / std::sqrt(length2) : Vec3{1, 0, 0};
  const Vec3 t2 = Cross(stretched, t1);
  const Vec2 disk = ConcentricDisk(u);
  const float p1 = disk.x;
  const float s = 0.5f * (1.0f + stretched.z);
  const float p2 = (1.0f - s) * std::sqrt(std::max(0.0f, 1.0f - p1 * p1)) + s * disk.y;
  const Vec3 n = t1 * p1 + t2 * p2 + stretched * std::sqrt(std::max(0.0f, 1.0f - p1 * p1 - p2 * p2));
  return Normalize(Vec3{alpha.x * n.x, alpha.y * n.y, std::max(1e-6f, n.z)});
}

float GgxVisibleDensity(Vec3 wo, Vec3 h, GgxAlpha alpha) {
  const float a2 = alpha.SquaredTowards(wo);
  const float cos_h = std::max(0.0f, Dot(wo, h));
  // G1(wo) / wo.z, in a form that is finite at grazing angles
  const float masking = 2.0f / (wo.z + std::sqrt(a2 + (1.0f - a2) * wo.z * wo.z));
  return masking * cos_h * GgxDensity(h, alpha);
}

float DielectricFresnel(float cos_i, float eta, float* cos_t) {
  const float sin2_t = (1.0f - cos_i * cos_i) / (eta * eta);
  if (sin2_t >= 1.0f) {
    *cos_t = 0;
    return 1;
  }
  *cos_t = std::sqrt(1.0f - sin2_t);
  const float parallel = (eta * cos_i - *cos_t) / (eta * cos_i + *cos_t);
  const float perpendicular = (cos_i - eta * *cos_t) / (cos_i + eta * *cos_t);
  return 0.5f * (parallel * parallel + perpendicular * perpendicular);
}

}  // namespace lumifold::render
