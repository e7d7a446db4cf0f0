#include "worker/render/materials/albedo_table.h"

#include <algorithm>
#include <cmath>

#include "filter/image/check.h"
#include "filter/image/portable_math.h"
#include "worker/render/materials/microfacet.h"
#include "worker/render/materials/sheen.h"

namespace lumifold::render {
namespace {

// All integrals use fixed point sets, so they are deterministic and smooth in their arguments.
constexpr int kPointBits = 10;
/// Anisotropic lobes have as many nodes as a thousand points each would take a second for. Of these the
/// integral is within 0.3 %.
constexpr int kFewPointBits = 8;

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
template <int kBits>
constexpr std::array<Vec2, 1 << kBits> HammersleyPoints() {
  constexpr int kPoints = 1 << kBits;
  std::array<Vec2, kPoints> points;
  for (int i = 0; i < kPoints; ++i) {
    int reversed = 0;
    for (int bit = 0; bit < kBits; ++bit) reversed |= ((i >> bit) & 1) << (kBits - 1 - bit);
    points[i] = {(static_cast<float>(i) + 0.5f) / kPoints, (static_cast<float>(reversed) + 0.5f) / kPoints};
  }
  return points;
}

template <int kBits>
constexpr std::array<Vec2, 1 << kBits> kSquare = HammersleyPoints<kBits>();

/// The mean of f over the unit square.
template <int kBits = kPointBits, typename F>
auto MeanOverSquare(const F& f) {
  decltype(f(Vec2{})) sum = {};
  for (const Vec2 u : kSquare<kBits>) sum += f(u);
  return sum * (1.0f / (1 << kBits));
}

template <int kBits = kPointBits>
DirectionalAlbedo IntegrateReflection(Vec3 wo, GgxAlpha alpha) {
  const Vec2 mean = MeanOverSquare<kBits>([&](Vec2 u) {
    const Vec3 h = SampleGgxVisibleNormal(wo, alpha, ConcentricDisk(u));
    const float cos_h = Dot(wo, h);
    const Vec3 wi = MirrorDirection(wo, h);
    if (wi.z <= 0) return Vec2{};
    const float value = GgxShadowing(wi, wo, alpha);
    const float m = 1.0f - cos_h;
    const float m5 = m * m * m * m * m;
    return Vec2{value * (1.0f - m5), value * m5};
  });
  return {mean.x, mean.y};
}

float IntegrateGlass(float cos_o, GgxAlpha alpha, float eta) {
  const Vec3 wo = DirectionOf(cos_o);
  return MeanOverSquare([&](Vec2 u) {
    const Vec3 h = SampleGgxVisibleNormal(wo, alpha, ConcentricDisk(u));
    const float cos_h = Dot(wo, h);
    float cos_t = 0;
    const float fresnel = DielectricFresnel(cos_h, eta, &cos_t);
    const Vec3 up = MirrorDirection(wo, h);
    const Vec3 down = Refract(wo, h, eta, cos_t);
    float value = up.z > 0 ? fresnel * GgxShadowing(up, wo, alpha) : 0.0f;
    if (fresnel < 1 && down.z < 0) value += (1.0f - fresnel) * GgxShadowing(down, wo, alpha);
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

/// Nodes of the axes of the anisotropic table: strength of the anisotropy, roughness across it, cosine of the
/// azimuth against it, and cosine. Interpolated within 1 % of the albedo but at grazing angles (4 %).
constexpr std::array<int, 4> kAnisotropicSizes = {6, 8, 5, 12};

/// Interpolates the part of the anisotropic table that `table` points to, along `axis` and all later ones.
DirectionalAlbedo Multilinear(const DirectionalAlbedo* table, const std::array<float, 4>& place,
                              size_t axis) {
  if (axis == place.size()) return *table;
  std::ptrdiff_t stride = 1;
  for (size_t later = axis + 1; later < place.size(); ++later) stride *= kAnisotropicSizes[later];
  const Node node = NodeAt(place[axis], kAnisotropicSizes[axis]);
  const DirectionalAlbedo* first = table + node.index * stride;
  return Mix(Multilinear(first, place, axis + 1), Multilinear(first + stride, place, axis + 1),
             node.fraction);
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
  if (contents.anisotropic) BuildAnisotropic();
  for (const float ior : glass_iors_) {
    for (const float eta : {ior, 1.0f / ior}) {
      Fill(&glass_.emplace_back(),
           [eta](float cos_o, float alpha) { return IntegrateGlass(cos_o, GgxAlpha(alpha), eta); });
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
      table_[r][c] = IntegrateReflection(DirectionOf(cos_o), GgxAlpha(roughness * roughness));
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

void AlbedoTable::BuildAnisotropic() {
  const auto at = [](size_t node, size_t axis) {
    return static_cast<float>(node) / static_cast<float>(kAnisotropicSizes[axis] - 1);
  };
  const auto [strengths, roughnesses, azimuths, cosines] = kAnisotropicSizes;
  anisotropic_.reserve(static_cast<size_t>(strengths) * roughnesses * azimuths * cosines);
  for (int s = 0; s < strengths; ++s) {
    for (int r = 0; r < roughnesses; ++r) {
      const float roughness = std::max(at(r, 1), kMinRoughness);
      const float across = roughness * roughness;
      const GgxAlpha alpha = {Lerp(across, 1, at(s, 0) * at(s, 0)), across};
      for (int a = 0; a < azimuths; ++a) {
        const Vec3 along = DirectionOf(at(a, 2));  // its z is the azimuth's cosine
        for (int c = 0; c < cosines; ++c) {
          const Vec3 wo = DirectionOf(std::max(at(c, 3), kMinCosine));
          anisotropic_.push_back(
              IntegrateReflection<kFewPointBits>({wo.x * along.z, wo.x * along.x, wo.z}, alpha));
        }
      }
    }
  }
}

DirectionalAlbedo AlbedoTable::LookupAnisotropic(Vec3 wo, GgxAlpha alpha) const {
  LUMIFOLD_CHECK(!anisotropic_.empty());
  const float sine = std::sqrt(wo.x * wo.x + wo.y * wo.y);
  const float strength = std::sqrt((alpha.x - alpha.y) / (1.0f - alpha.y));
  const std::array<float, 4> place = {strength, std::sqrt(alpha.y), sine > 0 ? std::abs(wo.x) / sine : 1.0f,
                                      wo.z};
  return Multilinear(anisotropic_.data(), place, 0);
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
    contents.anisotropic |= material.base.anisotropy.strength > 0;
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
