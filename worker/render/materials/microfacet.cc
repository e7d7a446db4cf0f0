#include "worker/render/materials/microfacet.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {

float GgxDensity(Vec3 h, float alpha) {
  const float a2 = alpha * alpha;
  // The textbook form cos^2 (a2 - 1) + 1 suffers from cancellation at small alpha; this form does not.
  const float t = a2 * h.z * h.z + h.x * h.x + h.y * h.y;
  return a2 / (kPi * t * t);
}

float GgxVisibility(float cos_i, float cos_o, float alpha) {
  const float a2 = alpha * alpha;
  const float lambda_o = cos_i * std::sqrt(cos_o * cos_o * (1.0f - a2) + a2);
  const float lambda_i = cos_o * std::sqrt(cos_i * cos_i * (1.0f - a2) + a2);
  return 0.5f / (lambda_o + lambda_i);
}

float GgxShadowing(float cos_i, float cos_o, float alpha) {
  const float a2 = alpha * alpha;
  const float root_o = std::sqrt(cos_o * cos_o * (1.0f - a2) + a2);
  const float root_i = std::sqrt(cos_i * cos_i * (1.0f - a2) + a2);
  return cos_i * (cos_o + root_o) / (cos_i * root_o + cos_o * root_i);
}

Vec3 SampleGgxVisibleNormal(Vec3 wo, float alpha, Vec2 u) {
  const Vec3 stretched = Normalize(Vec3{alpha * wo.x, alpha * wo.y, wo.z});
  const float length2 = stretched.x * stretched.x + stretched.y * stretched.y;
  const Vec3 t1 = length2 > 0 ? Vec3{-stretched.y, stretched.x, 0} / std::sqrt(length2) : Vec3{1, 0, 0};
  const Vec3 t2 = Cross(stretched, t1);
  const Vec2 disk = ConcentricDisk(u);
  const float p1 = disk.x;
  const float s = 0.5f * (1.0f + stretched.z);
  const float p2 = (1.0f - s) * std::sqrt(std::max(0.0f, 1.0f - p1 * p1)) + s * disk.y;
  const Vec3 n = t1 * p1 + t2 * p2 + stretched * std::sqrt(std::max(0.0f, 1.0f - p1 * p1 - p2 * p2));
  return Normalize(Vec3{alpha * n.x, alpha * n.y, std::max(1e-6f, n.z)});
}

float GgxVisibleDensity(Vec3 wo, Vec3 h, float alpha) {
  const float a2 = alpha * alpha;
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
