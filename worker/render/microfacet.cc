#include "worker/render/microfacet.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

DirectionalAlbedo Mix(const DirectionalAlbedo& a, const DirectionalAlbedo& b, float t) {
  return {a.scale + (b.scale - a.scale) * t, a.bias + (b.bias - a.bias) * t};
}

/// Integrates the lobe over its own sampling density with a fixed grid of midpoints: deterministic, and
/// smooth in both arguments.
DirectionalAlbedo IntegrateAlbedo(float cos_o, float alpha) {
  constexpr int kGrid = 24;
  const Vec3 wo = {std::sqrt(1.0f - cos_o * cos_o), 0, cos_o};
  double scale = 0;
  double bias = 0;
  for (int i = 0; i < kGrid; ++i) {
    for (int j = 0; j < kGrid; ++j) {
      const Vec2 u = {(static_cast<float>(i) + 0.5f) / kGrid, (static_cast<float>(j) + 0.5f) / kGrid};
      const Vec3 h = SampleGgxVisibleNormal(wo, alpha, u);
      const float cos_h = Dot(wo, h);
      const Vec3 wi = h * (2.0f * cos_h) - wo;
      if (wi.z <= 0) continue;
      // lobe * cos / density, with the density of wi: D_visible(h) / (4 cos_h)
      const float value = GgxVisibility(wi.z, wo.z, alpha) * GgxDensity(h, alpha) * wi.z * 4.0f * cos_h /
                          GgxVisibleDensity(wo, h, alpha);
      const float m = 1.0f - cos_h;
      const float m5 = m * m * m * m * m;
      scale += static_cast<double>(value * (1.0f - m5));
      bias += static_cast<double>(value * m5);
    }
  }
  return {static_cast<float>(scale / (kGrid * kGrid)), static_cast<float>(bias / (kGrid * kGrid))};
}

}  // namespace

float GgxDensity(Vec3 h, float alpha) {
  const float a2 = alpha * alpha;
  // The textbook cos^2 (a2 - 1) + 1 cancels at small alpha; this form keeps its digits.
  const float t = a2 * h.z * h.z + h.x * h.x + h.y * h.y;
  return a2 / (kPi * t * t);
}

float GgxVisibility(float cos_i, float cos_o, float alpha) {
  const float a2 = alpha * alpha;
  const float lambda_o = cos_i * std::sqrt(cos_o * cos_o * (1.0f - a2) + a2);
  const float lambda_i = cos_o * std::sqrt(cos_i * cos_i * (1.0f - a2) + a2);
  return 0.5f / (lambda_o + lambda_i);
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
  // G1(wo) / wo.z, written so that it stays finite at grazing angles
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

AlbedoTable::AlbedoTable() {
  for (int r = 0; r < kSize; ++r) {
    const float roughness = std::max(static_cast<float>(r) / (kSize - 1), 0.05f);
    for (int c = 0; c < kSize; ++c) {
      const float cos_o = std::max(static_cast<float>(c) / (kSize - 1), 0.01f);
      table_[r][c] = IntegrateAlbedo(cos_o, roughness * roughness);
    }
    // The exact mean of 2 c A(c) for the piecewise linear A that Lookup gives.
    constexpr float kStep = 1.0f / (kSize - 1);
    for (int c = 0; c + 1 < kSize; ++c) {
      const float begin = static_cast<float>(c) * kStep;
      const float left = kStep * (begin + kStep / 3);
      const float right = kStep * (begin + 2 * kStep / 3);
      average_[r].scale += left * table_[r][c].scale + right * table_[r][c + 1].scale;
      average_[r].bias += left * table_[r][c].bias + right * table_[r][c + 1].bias;
    }
  }
}

DirectionalAlbedo AlbedoTable::Lookup(float cos_o, float alpha) const {
  const float r = std::clamp(std::sqrt(alpha), 0.0f, 1.0f) * (kSize - 1);
  const float c = std::clamp(cos_o, 0.0f, 1.0f) * (kSize - 1);
  const int r0 = std::min(static_cast<int>(r), kSize - 2);
  const int c0 = std::min(static_cast<int>(c), kSize - 2);
  const float ct = c - static_cast<float>(c0);
  const float rt = r - static_cast<float>(r0);
  return Mix(Mix(table_[r0][c0], table_[r0][c0 + 1], ct), Mix(table_[r0 + 1][c0], table_[r0 + 1][c0 + 1], ct),
             rt);
}

DirectionalAlbedo AlbedoTable::Average(float alpha) const {
  const float r = std::clamp(std::sqrt(alpha), 0.0f, 1.0f) * (kSize - 1);
  const int r0 = std::min(static_cast<int>(r), kSize - 2);
  return Mix(average_[r0], average_[r0 + 1], r - static_cast<float>(r0));
}

}  // namespace lumifold::render
