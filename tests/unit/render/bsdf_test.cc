#include "worker/render/materials/bsdf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "filter/image/portable_math.h"
#include "worker/render/sampling/sampler.h"

namespace lumifold::render {
namespace {

const Vec3 kUp = {0, 0, 1};

constexpr float kGlassIor = 1.5f;
constexpr float kDenseIor = 2.0f;

const AlbedoTable& Table() {
  static const AlbedoTable table({.anisotropic = true, .sheen = true, .glass_iors = {kGlassIor, kDenseIor}});
  return table;
}

Vec3 DirectionAt(double cosine, double phi) {
  const double sine = std::sqrt(1 - cosine * cosine);
  return {static_cast<float>(sine * std::cos(phi)), static_cast<float>(sine * std::sin(phi)),
          static_cast<float>(cosine)};
}

Bsdf Make(const SurfaceMaterial& material, Vec3 wo) { return {material, Table(), kUp, kUp, wo}; }

Vec3 Total(const Bsdf& bsdf, const BsdfValue& value) {
  return bsdf.DiffuseAlbedo() * value.diffuse + value.non_diffuse;
}

SurfaceMaterial Plastic(float roughness) {
  SurfaceMaterial m;
  m.base_color = {0.8f, 0.5f, 0.2f};
  m.roughness = roughness;
  return m;
}

SurfaceMaterial Metal(float roughness) {
  SurfaceMaterial m;
  m.base_color = {0.9f, 0.7f, 0.4f};
  m.metallic = 1;
  m.roughness = roughness;
  return m;
}

SurfaceMaterial Glass(float roughness, bool thin, bool inside) {
  SurfaceMaterial m;
  m.base_color = {0.9f, 0.8f, 0.7f};
  m.roughness = roughness;
  m.transmission = 1;
  m.ior = kGlassIor;
  m.thin = thin;
  m.inside = inside;
  return m;
}

SurfaceMaterial Coated(SurfaceMaterial m, float coat_roughness) {
  m.clearcoat = 0.8f;
  m.clearcoat_roughness = coat_roughness;
  m.coat_normal = Normalize(Vec3{0.2f, -0.1f, 1});
  return m;
}

SurfaceMaterial Cloth(float sheen_roughness) {
  SurfaceMaterial m = Plastic(0.9f);
  m.sheen_color = {0.5f, 0.6f, 0.9f};
  m.sheen_roughness = sheen_roughness;
  return m;
}

SurfaceMaterial Brushed(SurfaceMaterial m, float strength) {
  m.rare.anisotropy = Vec3{0.6f, 0.8f, 0} * strength;
  return m;
}

SurfaceMaterial Leaf(float roughness) {
  SurfaceMaterial m = Plastic(roughness);
  m.rare.diffuse_transmission = 0.6f;
  m.rare.diffuse_transmission_color = {0.3f, 0.9f, 0.2f};
  return m;
}

SurfaceMaterial Filmed(SurfaceMaterial m, float thickness_nm) {
  m.rare.iridescence = 0.9f;
  m.rare.film_thickness_nm = thickness_nm;
  return m;
}

struct BsdfCase {
  std::string name;
  SurfaceMaterial material;
};

std::vector<BsdfCase> Plastics() {
  std::vector<BsdfCase> all;
  for (const float roughness : {0.25f, 0.5f, 0.8f, 1.0f})
    all.push_back({"plastic " + std::to_string(roughness), Plastic(roughness)});
  return all;
}

/// Materials without delta lobes.
std::vector<BsdfCase> RoughMaterials() {
  std::vector<BsdfCase> all = Plastics();
  for (const float roughness : {0.25f, 0.6f, 1.0f}) {
    const std::string at = " " + std::to_string(roughness);
    all.push_back({"metal" + at, Metal(roughness)});
    all.push_back({"glass from outside" + at, Glass(roughness, false, false)});
    all.push_back({"glass from inside" + at, Glass(roughness, false, true)});
    all.push_back({"thin glass" + at, Glass(roughness, true, false)});
    all.push_back({"coated plastic" + at, Coated(Plastic(0.5f), roughness)});
    all.push_back({"cloth" + at, Cloth(roughness)});
    all.push_back({"filmed plastic" + at, Filmed(Plastic(roughness), 400)});
    all.push_back({"filmed metal" + at, Filmed(Metal(roughness), 300)});
    all.push_back({"filmed glass" + at, Filmed(Glass(roughness, false, false), 300)});
    all.push_back({"leaf" + at, Leaf(roughness)});
    all.push_back({"brushed plastic" + at, Brushed(Plastic(roughness), 0.7f)});
    all.push_back({"brushed metal" + at, Brushed(Metal(roughness), 0.5f)});
    all.push_back({"brushed glass" + at, Brushed(Glass(roughness, false, false), 0.6f)});
    all.push_back({"brushed thin glass" + at, Brushed(Glass(roughness, true, false), 0.6f)});
  }
  SurfaceMaterial mixed = Metal(0.5f);
  mixed.metallic = 0.5f;
  all.push_back({"half metal", mixed});
  mixed.transmission = 0.6f;
  mixed.thin = false;
  all.push_back({"half metal, partly glass", mixed});
  SurfaceMaterial everything = Coated(mixed, 0.4f);
  everything.sheen_color = {0.3f, 0.2f, 0.1f};
  everything.sheen_roughness = 0.5f;
  all.push_back({"everything at once", everything});
  return all;
}

/// Integrates `f(direction)` over all directions by the midpoint rule; directions below the surface only if
/// they matter.
template <typename F>
double IntegrateDirections(const SurfaceMaterial& material, const F& f) {
  constexpr int kCosines = 300;
  constexpr int kAngles = 300;
  const bool transmits = material.transmission > 0 || material.rare.diffuse_transmission > 0;
  const int lowest = transmits ? -kCosines : 0;
  double sum = 0;
  for (int i = lowest; i < kCosines; ++i) {
    for (int j = 0; j < kAngles; ++j)
      sum += f(DirectionAt((i + 0.5) / kCosines, 2 * M_PI * (j + 0.5) / kAngles));
  }
  return sum * 2 * M_PI / (kCosines * kAngles);
}

/// The mean weight of sampled directions: the albedo towards the viewer.
double SampledAlbedo(const Bsdf& bsdf) {
  constexpr uint32_t kSamples = 1 << 15;
  double sum = 0;
  for (uint32_t i = 0; i < kSamples; ++i) {
    const Sampler sampler(3, 0, 0, 2 * i);
    const BsdfSample sample = bsdf.Sample(sampler.Get2D(0).x, sampler.Get2D(1));
    if (sample.valid) sum += static_cast<double>(Total(bsdf, sample.weight).y);
  }
  return sum / kSamples;
}

/// Directions below the horizon are sampled and rejected; the density of the others must integrate to their
/// fraction.
TEST(DiffuseOnly, IsTheLimitOfAVanishingReflection) {
  SurfaceMaterial bare;
  bare.base_color = {0.8f, 0.5f, 0.2f};
  bare.specular = 0;
  SurfaceMaterial covered = bare;
  covered.specular = 1e-7f;
  const Vec3 wo = DirectionAt(0.6, 1);
  const Vec3 geometric = Normalize(Vec3{0.3f, 0, 1});
  const Bsdf one(bare, Table(), kUp, geometric, wo);
  const Bsdf other(covered, Table(), kUp, geometric, wo);
  EXPECT_NEAR(one.DiffuseAlbedo().x, other.DiffuseAlbedo().x, 1e-5f);
  EXPECT_NEAR(one.Albedo().y, other.Albedo().y, 1e-5f);
  for (const double phi : {0.0, 2.0, 3.1}) {
    for (const double cosine : {-0.5, 0.1, 0.9}) {
      float pdf = 0;
      float other_pdf = 0;
      const BsdfValue value = one.Evaluate(DirectionAt(cosine, phi), &pdf);
      EXPECT_NEAR(value.diffuse, other.Evaluate(DirectionAt(cosine, phi), &other_pdf).diffuse, 1e-5f);
      EXPECT_NEAR(pdf, other_pdf, 1e-5f);
    }
  }
  for (const Vec2 u : {Vec2{0.2f, 0.3f}, Vec2{0.9f, 0.6f}, Vec2{0.01f, 0.5f}}) {
    const BsdfSample sample = one.Sample(0.4f, u);
    const BsdfSample same = other.Sample(0.4f, u);
    EXPECT_EQ(sample.valid, same.valid);
    if (!same.valid) continue;
    EXPECT_EQ(sample.wi, same.wi);
    EXPECT_NEAR(sample.pdf, same.pdf, 1e-5f);
    EXPECT_NEAR(sample.weight.diffuse, same.weight.diffuse, 1e-4f);
  }
}

TEST(Bsdf, DensityIntegratesToTheFractionOfValidSamples) {
  constexpr uint32_t kSamples = 1 << 14;
  for (const auto& [name, material] : RoughMaterials()) {
    for (const double cosine : {0.95, 0.6, 0.25}) {
      const Bsdf bsdf = Make(material, DirectionAt(cosine, 0.3));
      const double total = IntegrateDirections(material, [&](Vec3 wi) {
        float pdf = 0;
        bsdf.Evaluate(wi, &pdf);
        return static_cast<double>(pdf);
      });
      double valid = 0;
      for (uint32_t i = 0; i < kSamples; ++i) {
        const Sampler sampler(3, 0, 0, 2 * i);
        if (bsdf.Sample(sampler.Get2D(0).x, sampler.Get2D(1)).valid) valid += 1.0 / kSamples;
      }
      EXPECT_NEAR(total, valid, 5e-3) << name << " cosine " << cosine;
    }
  }
}

/// Other materials compensate for lost energy by a factor that depends on wo alone.
TEST(Bsdf, PlasticIsReciprocal) {
  for (const auto& [name, material] : Plastics()) {
    const Vec3 a = DirectionAt(0.8, 0.2);
    const Vec3 b = DirectionAt(0.35, 2.1);
    float pdf = 0;
    const Bsdf from_a = Make(material, a);
    const Bsdf from_b = Make(material, b);
    const Vec3 ab = Total(from_a, from_a.Evaluate(b, &pdf)) / b.z;
    const Vec3 ba = Total(from_b, from_b.Evaluate(a, &pdf)) / a.z;
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(ab[i], ba[i], 2e-3f * ba[i]) << name;
  }
}

TEST(Bsdf, DiffuseLobeIsLossless) {
  for (const auto& [name, material] : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.7, 0));
    if (!bsdf.HasDiffuse()) continue;
    const double total = IntegrateDirections(material, [&](Vec3 wi) {
      float pdf = 0;
      return static_cast<double>(bsdf.Evaluate(wi, &pdf).diffuse);
    });
    EXPECT_NEAR(total, 1, 2e-3) << name;
  }
}

/// White materials conserve energy at every roughness, for rays from outside and inside.
TEST(Bsdf, WhiteFurnaceHolds) {
  for (const float roughness : {0.0f, 0.1f, 0.3f, 0.5f, 0.75f, 1.0f}) {
    std::vector<BsdfCase> whites = {{"plastic", Plastic(roughness)},
                                    {"metal", Metal(roughness)},
                                    {"glass from outside", Glass(roughness, false, false)},
                                    {"glass from inside", Glass(roughness, false, true)},
                                    {"thin glass", Glass(roughness, true, false)},
                                    {"coated plastic", Coated(Plastic(0.6f), roughness)},
                                    {"coated metal", Coated(Metal(0.6f), roughness)},
                                    {"cloth", Cloth(roughness)},
                                    {"filmed thin glass", Filmed(Glass(roughness, true, false), 500)},
                                    {"filmed glass", Filmed(Glass(roughness, false, false), 300)},
                                    {"filmed glass from inside", Filmed(Glass(roughness, false, true), 300)},
                                    {"leaf", Leaf(roughness)},
                                    {"coated leaf", Coated(Leaf(0.6f), roughness)},
                                    {"brushed plastic", Brushed(Plastic(roughness), 0.8f)},
                                    {"brushed metal", Brushed(Metal(roughness), 0.6f)},
                                    {"strongly brushed metal", Brushed(Metal(roughness), 1)},
                                    {"brushed thin glass", Brushed(Glass(roughness, true, false), 0.6f)}};
    SurfaceMaterial mixed = Metal(roughness);
    mixed.metallic = 0.4f;
    mixed.transmission = 0.7f;
    whites.push_back({"metal, glass and plastic", mixed});
    for (auto& [name, material] : whites) {
      material.base_color = {1, 1, 1};
      material.rare.diffuse_transmission_color = {1, 1, 1};
      material.sheen_color = MaxComponent(material.sheen_color) > 0 ? Vec3{1, 1, 1} : Vec3{0, 0, 0};
      material.coat_normal = kUp;
      const double tolerance = LengthSquared(material.rare.anisotropy) > 0 ? 0.02 : 0.01;
      for (const double cosine : {0.99, 0.7, 0.4, 0.2}) {
        EXPECT_NEAR(SampledAlbedo(Make(material, DirectionAt(cosine, 0.4))), 1, tolerance)
            << name << " roughness " << roughness << " cosine " << cosine;
      }
    }
  }
}

/// The mean weight of samples must equal the integral of the lobes.
TEST(Bsdf, SamplingAgreesWithEvaluation) {
  for (const auto& [name, material] : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.6, 1));
    const double integral = IntegrateDirections(material, [&](Vec3 wi) {
      float pdf = 0;
      return static_cast<double>(Total(bsdf, bsdf.Evaluate(wi, &pdf)).y);
    });
    EXPECT_NEAR(SampledAlbedo(bsdf), integral, 6e-3) << name;
  }
}

/// The base receives what the strongest channel of the film passes.
TEST(Bsdf, FilmsDoNotCreateLight) {
  for (const float roughness : {0.0f, 0.3f, 0.6f, 1.0f}) {
    for (const float thickness : {150.0f, 400.0f, 900.0f}) {
      for (const double cosine : {0.99, 0.6, 0.25}) {
        SurfaceMaterial plastic = Filmed(Plastic(roughness), thickness);
        plastic.base_color = {1, 1, 1};
        plastic.rare.iridescence = 1;
        const Bsdf bsdf = Make(plastic, DirectionAt(cosine, 0.4));
        Vec3 sum;
        constexpr uint32_t kSamples = 1 << 13;
        for (uint32_t i = 0; i < kSamples; ++i) {
          const Sampler sampler(3, 0, 0, 2 * i);
          const BsdfSample sample = bsdf.Sample(sampler.Get2D(0).x, sampler.Get2D(1));
          if (sample.valid) sum += Total(bsdf, sample.weight) / kSamples;
        }
        EXPECT_NEAR(MaxComponent(sum), 1, 0.03) << roughness << " " << thickness << " " << cosine;
      }
    }
  }
}

TEST(Bsdf, SmoothFilmsHaveTheFilmsReflectance) {
  const Vec3 wo = DirectionAt(0.6, 1);
  SurfaceMaterial metal = Filmed(Metal(0), 350);
  metal.rare.iridescence = 1;
  const Vec3 expected = ThinFilm(350, metal.rare.film_ior, 1, metal.base_color).Reflectance(wo.z);
  const Vec3 got = Make(metal, wo).DeltaReflection().weight.non_diffuse;
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(got[i], expected[i], 1e-6f);
  EXPECT_GT(Length(got - Make(Metal(0), wo).DeltaReflection().weight.non_diffuse), 0.1f);
  // A soap bubble: the film is all there is between air and air.
  SurfaceMaterial bubble = Filmed(Glass(0, true, false), 350);
  bubble.rare.iridescence = 1;
  bubble.ior = 1;
  const Vec3 film = ThinFilm(350, bubble.rare.film_ior, 1, {0, 0, 0}).Reflectance(wo.z);
  const Bsdf bsdf = Make(bubble, wo);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(bsdf.DeltaReflection().weight.non_diffuse[i], film[i], 1e-6f);
    EXPECT_NEAR(bsdf.StraightTransmittance()[i], bubble.base_color[i] * (1 - film[i]), 1e-6f);
  }
}

/// Without a dielectric layer both lobes of a leaf are Lambert's, each with its share.
TEST(Bsdf, LeavesReflectAndTransmitLikeLambert) {
  SurfaceMaterial leaf = Leaf(0.5f);
  leaf.specular = 0;
  const Bsdf bsdf = Make(leaf, DirectionAt(0.6, 1));
  for (const double cosine : {0.9, 0.5, 0.1}) {
    float pdf = 0;
    const float lambert = static_cast<float>(cosine) / kPi;
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(Total(bsdf, bsdf.Evaluate(DirectionAt(cosine, 2), &pdf))[i],
                  0.4f * leaf.base_color[i] * lambert, 1e-6f);
      EXPECT_NEAR(Total(bsdf, bsdf.Evaluate(-DirectionAt(cosine, 2), &pdf))[i],
                  0.6f * leaf.rare.diffuse_transmission_color[i] * lambert, 1e-6f);
    }
  }
  EXPECT_EQ(Make(leaf, DirectionAt(0.6, 1)).ReflectionAlpha(), 1);
}

/// S must be close to the integral of the glossy lobes, and never black if they scatter any light.
TEST(Bsdf, GlossyAlbedoIsTheIntegralOfItsLobes) {
  for (const auto& [name, material] : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.6, 1));
    for (int channel = 0; channel < 3; ++channel) {
      const double integral = IntegrateDirections(material, [&](Vec3 wi) {
        float pdf = 0;
        return static_cast<double>(bsdf.Evaluate(wi, &pdf).non_diffuse[channel]);
      });
      const auto albedo = static_cast<double>(bsdf.GlossyAlbedo()[channel]);
      EXPECT_GT(albedo, 0) << name;
      const double of_angles = material.rare.iridescence > 0 ? 0.01 : 0;  // a film's S is that at one angle
      EXPECT_NEAR(albedo, integral, 0.3 * integral + of_angles) << name;
    }
  }
}

/// Pearson's chi-squared test of the sampled directions against their density, on a grid over the sphere.
TEST(Bsdf, DirectionsFollowTheirDensity) {
  constexpr int kRows = 24;  // of equal cosines from -1 to 1
  constexpr int kColumns = 16;
  constexpr uint32_t kSamples = 100000;
  for (const auto& [name, material] : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.7, 0.5));
    std::vector<double> expected(kRows * kColumns, 0);
    constexpr int kFine = 20;
    for (int r = 0; r < kRows * kFine; ++r) {
      for (int c = 0; c < kColumns * kFine; ++c) {
        float pdf = 0;
        bsdf.Evaluate(
            DirectionAt(2 * (r + 0.5) / (kRows * kFine) - 1, 2 * M_PI * (c + 0.5) / (kColumns * kFine)),
            &pdf);
        expected[(r / kFine) * kColumns + c / kFine] +=
            static_cast<double>(pdf) * 4 * M_PI / (kRows * kFine * kColumns * kFine);
      }
    }
    std::vector<double> observed(kRows * kColumns, 0);
    uint64_t state = 1;
    const auto next = [&state] { return static_cast<float>(MixBits(state++) >> 40) * 0x1p-24f; };
    for (uint32_t i = 0; i < kSamples; ++i) {
      const float lobe = next();
      const float x = next();
      const float y = next();
      const BsdfSample sample = bsdf.Sample(lobe, {x, y});
      if (!sample.valid) continue;
      const double phi = std::atan2(static_cast<double>(sample.wi.y), static_cast<double>(sample.wi.x));
      const int row = std::clamp(static_cast<int>((sample.wi.z + 1) * 0.5f * kRows), 0, kRows - 1);
      const int column =
          std::min(static_cast<int>((phi < 0 ? phi + 2 * M_PI : phi) / (2 * M_PI) * kColumns), kColumns - 1);
      observed[row * kColumns + column] += 1;
    }
    double chi2 = 0;
    int cells = 0;
    for (size_t i = 0; i < expected.size(); ++i) {
      const double e = expected[i] * kSamples;
      if (e < 10) continue;
      chi2 += (observed[i] - e) * (observed[i] - e) / e;
      ++cells;
    }
    // Five standard deviations of chi-squared, plus the error of the midpoint rule in steep cells.
    EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells) + 0.3 * cells) << name;
  }
}

TEST(Bsdf, GlassConservesEnergy) {
  SurfaceMaterial glass;
  glass.base_color = {1, 1, 1};
  glass.roughness = 0;
  glass.transmission = 1;
  for (const bool inside : {false, true}) {
    for (const bool thin : {false, true}) {
      glass.inside = inside;
      glass.thin = thin;
      for (const double cosine : {1.0, 0.7, 0.3}) {
        const Bsdf bsdf = Make(glass, DirectionAt(cosine, 0));
        double sum = 0;
        constexpr int kSteps = 10000;
        for (int i = 0; i < kSteps; ++i) {
          const BsdfSample sample = bsdf.Sample((static_cast<float>(i) + 0.5f) / kSteps, {0.5f, 0.5f});
          ASSERT_TRUE(sample.valid);
          sum += static_cast<double>(sample.weight.non_diffuse.y);
        }
        EXPECT_NEAR(sum / kSteps, 1, 1e-3) << "inside " << inside << " thin " << thin << " cosine " << cosine;
      }
    }
  }
}

TEST(Bsdf, RefractionObeysSnellsLaw) {
  SurfaceMaterial glass;
  glass.roughness = 0;
  glass.transmission = 1;
  glass.thin = false;
  glass.ior = 1.5f;
  const Vec3 wo = DirectionAt(0.6, 0);
  const BsdfSample sample = Make(glass, wo).Sample(0.999f, {0.5f, 0.5f});
  ASSERT_TRUE(sample.transmitted);
  EXPECT_NEAR(Length(sample.wi), 1, 1e-6);
  EXPECT_NEAR(-sample.wi.x * 1.5f, wo.x, 1e-5);
  EXPECT_LT(sample.wi.z, 0);
}

/// A narrow rough lobe must converge to the smooth limit.
TEST(Bsdf, SlightlyRoughGlassRefractsAboutSnellsDirection) {
  const Vec3 wo = DirectionAt(0.6, 0);
  const BsdfSample smooth = Make(Glass(0, false, false), wo).Sample(0.999f, {0.5f, 0.5f});
  const Bsdf rough = Make(Glass(0.1f, false, false), wo);
  Vec3 mean;
  for (uint32_t i = 0; i < 4096; ++i) {
    const BsdfSample sample = rough.Sample(0.999f, Sampler(3, 0, 0, 2 * i).Get2D(1));
    ASSERT_TRUE(sample.transmitted);
    mean += sample.wi / 4096;
  }
  EXPECT_LT(Length(mean - smooth.wi), 0.01f);
}

TEST(Bsdf, OnlyClearPanesTransmitStraight) {
  const Vec3 wo = DirectionAt(0.6, 0);
  EXPECT_NEAR(Make(Glass(0, true, false), wo).StraightTransmittance().y, 0.8f, 0.12f);
  EXPECT_EQ(Make(Glass(0, true, false), wo).StraightTransmittance(),
            Make(Glass(0, true, true), wo).StraightTransmittance());
  EXPECT_EQ(Make(Glass(0, false, false), wo).StraightTransmittance(), (Vec3{0, 0, 0}));
  EXPECT_EQ(Make(Glass(0.5f, true, false), wo).StraightTransmittance(), (Vec3{0, 0, 0}));
  EXPECT_EQ(Make(Plastic(0), wo).StraightTransmittance(), (Vec3{0, 0, 0}));
}

constexpr int kSmallNodes = 24;  // of glass and sheen
constexpr int kReflectionNodes = 32;

/// The value at the place between nodes that is a part `r` further in roughness and `c` further in cosine, by
/// the four nodes around it.
template <typename AtNode>
float Between(const AtNode& at_node, int row, int column, float r, float c) {
  return (1 - r) * ((1 - c) * at_node(row, column) + c * at_node(row, column + 1)) +
         r * ((1 - c) * at_node(row + 1, column) + c * at_node(row + 1, column + 1));
}

/// Compares `at(cosine, alpha)` with Between() of its own values at the nodes, of which there are `nodes`.
template <typename At>
void ExpectBilinear(const At& at, int nodes) {
  const auto place = [&](float row, float column) {
    const float roughness = row / static_cast<float>(nodes - 1);
    return at(column / static_cast<float>(nodes - 1), roughness * roughness);
  };
  const auto at_node = [&](int row, int column) {
    return place(static_cast<float>(row), static_cast<float>(column));
  };
  for (const int row : {0, nodes / 2, nodes - 2}) {
    for (const int column : {0, nodes / 3, nodes - 2}) {
      EXPECT_NEAR(place(static_cast<float>(row) + 0.75f, static_cast<float>(column) + 0.25f),
                  Between(at_node, row, column, 0.75f, 0.25f), 2e-5f)
          << row << " " << column;
    }
  }
  EXPECT_NE(at_node(1, 3), at_node(3, 1)) << "of roughness and cosine";
}

TEST(AlbedoTable, GlassIsInterpolatedBetweenItsIors) {
  constexpr float kCosine = 0.4f;
  constexpr float kAlpha = 0.3f;
  for (const bool inside : {false, true}) {
    const auto at = [&](float ior) { return Table().Glass(ior, inside, kCosine, kAlpha); };
    const float low = at(kGlassIor);
    const float high = at(kDenseIor);
    EXPECT_GT(std::abs(low - high), 1e-4f);
    EXPECT_NEAR(at(kGlassIor + 0.25f * (kDenseIor - kGlassIor)), 0.75f * low + 0.25f * high, 1e-6f);
    EXPECT_EQ(at(kGlassIor - 0.1f), low);
    EXPECT_EQ(at(kDenseIor + 0.1f), high);
    ExpectBilinear([&](float cosine, float alpha) { return Table().Glass(kGlassIor, inside, cosine, alpha); },
                   kSmallNodes);
  }
  EXPECT_NE(Table().Glass(kGlassIor, false, kCosine, kAlpha),
            Table().Glass(kGlassIor, true, kCosine, kAlpha));
}

TEST(AlbedoTable, ReflectionIsInterpolatedInRoughnessAndCosine) {
  const AlbedoTable& table = Table();
  ExpectBilinear([&](float cosine, float alpha) { return table.Lookup(cosine, alpha).scale; },
                 kReflectionNodes);
  ExpectBilinear([&](float cosine, float alpha) { return table.Lookup(cosine, alpha).bias; },
                 kReflectionNodes);
  ExpectBilinear([&](float cosine, float alpha) { return table.Sheen(cosine, alpha); }, kSmallNodes);
  // The mean over the hemisphere is that of Lookup(), also between nodes.
  for (const float alpha : {0.1f, 0.37f, 0.8f}) {
    double scale = 0;
    double bias = 0;
    constexpr int kSteps = 4000;
    for (int i = 0; i < kSteps; ++i) {
      const float cosine = (static_cast<float>(i) + 0.5f) / kSteps;
      const DirectionalAlbedo albedo = table.Lookup(cosine, alpha);
      scale += static_cast<double>(2 * cosine * albedo.scale) / kSteps;
      bias += static_cast<double>(2 * cosine * albedo.bias) / kSteps;
    }
    EXPECT_NEAR(table.Average(alpha).scale, scale, 1e-5) << alpha;
    EXPECT_NEAR(table.Average(alpha).bias, bias, 1e-5) << alpha;
  }
}

TEST(AlbedoTable, HasTheIorsOfRoughSolidGlassOnceEachAndSomeOfMany) {
  scene::Scene scene;
  const auto add = [&scene](float ior) -> scene::Material& {
    scene::Material& material = scene.materials.emplace_back();
    material.transmission.factor = 1;
    material.volume.is_solid = true;
    material.ior = ior;
    return material;
  };
  for (const float ior : {1.5f, 1.3f, 1.5f}) add(ior);
  add(1.1f).unlit = true;
  add(1.2f).volume.is_solid = false;
  add(1.4f).base.roughness = 0;
  add(1.6f).transmission.factor = 0;
  EXPECT_EQ(AlbedoContentsOf(scene).glass_iors, (std::vector<float>{1.3f, 1.5f}));
  EXPECT_FALSE(AlbedoContentsOf(scene).sheen);
  scene.materials[0].sheen.color = {0, 0, 0.1f};
  EXPECT_TRUE(AlbedoContentsOf(scene).sheen);
  scene.materials.clear();
  for (int i = 0; i <= 60; ++i) add(1 + static_cast<float>((i * 7) % 61) / 64);
  const std::vector<float> some = AlbedoContentsOf(scene).glass_iors;
  ASSERT_EQ(some.size(), 16u);
  for (size_t i = 0; i < some.size(); ++i) EXPECT_EQ(some[i], 1 + static_cast<float>(4 * i) / 64) << i;
}

}  // namespace
}  // namespace lumifold::render
