#include "worker/render/materials/microfacet.h"

#include <cmath>

namespace lumifold::render {

float GgxShadowing(Vec3 wi, Vec3 wo, GgxAlpha alpha) {
  const float a2_o = SquaredTowards(alpha, wo);
  const float a2_i = SquaredTowards(alpha, wi);
  const float cos_i = std::abs(wi.z);
  const float root_o = std::sqrt(wo.z * wo.z * (1.0f - a2_o) + a2_o);
  const float root_i = std::sqrt(cos_i * cos_i * (1.0f - a2_i) + a2_i);
  return cos_i * (wo.z + root_o) / (cos_i * root_o + wo.z * root_i);
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
