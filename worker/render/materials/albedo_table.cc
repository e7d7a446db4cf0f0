#include "worker/render/materials/albedo_table.h"

#include <algorithm>
#include <cmath>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"
#include "worker/render/materials/microfacet.h"
#include "worker/render/materials/sheen.h"

namespace lumifold::render {
namespace {

// All integrals use one fixed point set, so they are deterministic and smooth in their arguments.
constexpr int kPointBits = 10;
constexpr int kPoints = 1 << kPointBits;

// Lower ends of the tables' axes. Below this roughness lobes are nearly delta and their albedo hardly
// changes.
constexpr float kMinRoughness = 0.05f;
constexpr float kMinCosine = 0.01f;

float Lerp(float a, float b, float t) { return a + (b - a) * t; }

DirectionalAlbedo Mix(const DirectionalAlbedo& a, const DirectionalAlbedo& b, float t) {
  return {Lerp(a.scale, b.scale, t), Lerp(a.bias, b.bias, t)};
}

Vec3 DirectionOf(float cosine) { return {std::sqrt(1.0f - cosine * cosine), 0, cosine}; }

/// The Hammersley points: low discrepancy, also for integrands that end abruptly at the horizon.
constexpr std::array<Vec2, kPoints> HammersleyPoints() {
  std::array<Vec2, kPoints> points;
  for (int i = 0; i < kPoints; ++i) {
    int reversed = 0;
    for (int bit = 0; bit < kPointBits; ++bit) reversed |= ((i >> bit) & 1) << (kPointBits - 1 - bit);
    points[i] = {(static_cast<float>(i) + 0.5f) / kPoints, (static_cast<float>(reversed) + 0.5f) / kPoints};
  }
  return points;
}

constexpr std::array<Vec2, kPoints> kSquare = HammersleyPoints();

/// The mean of f over the unit square.
template <typename F>
auto MeanOverSquare(const F& f) {
  decltype(f(Vec2{})) sum = {};
  for (const Vec2 u : kSquare) sum += f(u);
  return sum * (1.0f / kPoints);
}

DirectionalAlbedo IntegrateReflection(float cos_o, float alpha) {
  const Vec3 wo = DirectionOf(cos_o);
  const Vec2 mean = MeanOverSquare([&](Vec2 u) {
    const Vec3 h = SampleGgxVisibleNormal(wo, alpha, u);
    const float cos_h = Dot(wo, h);
    const float up = h.z * 2.0f * cos_h - wo.z;
    if (up <= 0) return Vec2{};
    const float value = GgxShadowing(up, wo.z, alpha);
    const float m = 1.0f - cos_h;
    const float m5 = m * m * m * m * m;
    return Vec2{value * (1.0f - m5), value * m5};
  });
  return {mean.x, mean.y};
}

float IntegrateGlass(float cos_o, float alpha, float eta) {
  const Vec3 wo = DirectionOf(cos_o);
  return MeanOverSquare([&](Vec2 u) {
    const Vec3 h = SampleGgxVisibleNormal(wo, alpha, u);
    const float cos_h = Dot(wo, h);
    float cos_t = 0;
    const float fresnel = DielectricFresnel(cos_h, eta, &cos_t);
    const float up = h.z * 2.0f * cos_h - wo.z;
    const float down = -Refract(wo, h, eta, cos_t).z;
    float value = up > 0 ? fresnel * GgxShadowing(up, wo.z, alpha) : 0.0f;
    if (fresnel < 1 && down > 0) value += (1.0f - fresnel) * GgxShadowing(down, wo.z, alpha);
    return value;
  });
}

float IntegrateSheen(float cos_o, float alpha) {
  const Vec3 wo = DirectionOf(cos_o);
  return 2 * kPi * MeanOverSquare([&](Vec2 u) {
           float sine = 0;
           float cosine = 0;
           SinCos(kPi * u.y, &sine, &cosine);  // half the circle: the integrand is symmetric
           const float radius = std::sqrt(1.0f - u.x * u.x);
           return SheenLobe({radius * cosine, radius * sine, u.x}, wo, alpha);
         });
}

/// Upper limit of tabulated iors: building the tables of one takes tens of milliseconds.
constexpr size_t kMaxGlassIors = 16;

/// kMaxGlassIors of the values at equal steps, including the first and the last.
std::vector<float> Subset(const std::vector<float>& values) {
  std::vector<float> some;
  for (size_t i = 0; i < kMaxGlassIors; ++i)
    some.push_back(values[i * (values.size() - 1) / (kMaxGlassIors - 1)]);
  return some;
}

/// A position between two neighbouring nodes of an axis of `size` nodes from 0 to 1.
struct Node {
  int index;
  float fraction;
};

Node NodeAt(float x, int size) {
  const float place = std::clamp(x, 0.0f, 1.0f) * static_cast<float>(size - 1);
  const int index = std::min(static_cast<int>(place), size - 2);
  return {index, place - static_cast<float>(index)};
}

template <typename Table>
float Bilinear(const Table& table, float roughness, float cos_o) {
  const int size = static_cast<int>(table.size());
  const Node r = NodeAt(roughness, size);
  const Node c = NodeAt(cos_o, size);
  const auto along = [&](const auto& row) { return Lerp(row[c.index], row[c.index + 1], c.fraction); };
  return Lerp(along(table[r.index]), along(table[r.index + 1]), r.fraction);
}

/// Fills a table of albedo(cos_o, alpha).
template <typename Table, typename Albedo>
void Fill(Table* table, const Albedo& albedo) {
  const auto last = static_cast<float>(table->size() - 1);
  for (size_t r = 0; r < table->size(); ++r) {
    const float roughness = std::max(static_cast<float>(r) / last, kMinRoughness);
    for (size_t c = 0; c < table->size(); ++c) {
      const float cos_o = std::max(static_cast<float>(c) / last, kMinCosine);
      (*table)[r][c] = albedo(cos_o, roughness * roughness);
    }
  }
}

}  // namespace

AlbedoTable::AlbedoTable(const Contents& contents) : glass_iors_(contents.glass_iors) {
  if (contents.reflection) BuildReflection();
  for (const float ior : glass_iors_) {
    for (const float eta : {ior, 1.0f / ior}) {
      Fill(&glass_.emplace_back(),
           [eta](float cos_o, float alpha) { return IntegrateGlass(cos_o, alpha, eta); });
    }
  }
  if (contents.sheen) {
    Fill(&sheen_.emplace_back(), [](float cos_o, float alpha) {
      return IntegrateSheen(cos_o, std::max(alpha, 0.5f * kMinSheenAlpha));  // for the node below the minimum
    });
  }
}

void AlbedoTable::BuildReflection() {
  for (int r = 0; r < kSize; ++r) {
    const float roughness = std::max(static_cast<float>(r) / (kSize - 1), kMinRoughness);
    for (int c = 0; c < kSize; ++c) {
      const float cos_o = std::max(static_cast<float>(c) / (kSize - 1), kMinCosine);
      table_[r][c] = IntegrateReflection(cos_o, roughness * roughness);
    }
    // The exact integral of 2 c A(c) for the piecewise linear A that Lookup returns.
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
  const Node r = NodeAt(std::sqrt(alpha), kSize);
  const Node c = NodeAt(cos_o, kSize);
  const auto along = [&](const DirectionalAlbedo* row) {
    return Mix(row[c.index], row[c.index + 1], c.fraction);
  };
  return Mix(along(table_[r.index]), along(table_[r.index + 1]), r.fraction);
}

DirectionalAlbedo AlbedoTable::Average(float alpha) const {
  const Node r = NodeAt(std::sqrt(alpha), kSize);
  return Mix(average_[r.index], average_[r.index + 1], r.fraction);
}

float AlbedoTable::Sheen(float cos_o, float alpha) const {
  LUMIFOLD_CHECK(!sheen_.empty());
  return Bilinear(sheen_[0], std::sqrt(alpha), cos_o);
}

float AlbedoTable::Glass(float ior, bool inside, float cos_o, float alpha) const {
  LUMIFOLD_CHECK(!glass_iors_.empty());
  const float roughness = std::sqrt(alpha);
  const auto at = [&](size_t node) {
    return Bilinear(glass_[2 * node + (inside ? 1 : 0)], roughness, cos_o);
  };
  const auto above = std::lower_bound(glass_iors_.begin(), glass_iors_.end(), ior);
  const auto node = static_cast<size_t>(above - glass_iors_.begin());
  if (above == glass_iors_.end()) return at(node - 1);
  if (*above == ior || node == 0) return at(node);
  return Lerp(at(node - 1), at(node), (ior - above[-1]) / (above[0] - above[-1]));
}

AlbedoTable::Contents AlbedoContentsOf(const scene::Scene& scene) {
  AlbedoTable::Contents contents;
  for (const scene::Material& material : scene.materials) {
    if (material.unlit) continue;
    contents.sheen |= MaxComponent(material.sheen.color) > 0;
    if (material.transmission.factor > 0 && material.volume.is_solid && material.base.roughness > 0)
      contents.glass_iors.push_back(material.ior);
  }
  std::vector<float>& iors = contents.glass_iors;
  std::sort(iors.begin(), iors.end());
  iors.erase(std::unique(iors.begin(), iors.end()), iors.end());
  if (iors.size() > kMaxGlassIors) iors = Subset(iors);
  return contents;
}

}  // namespace lumifold::render
