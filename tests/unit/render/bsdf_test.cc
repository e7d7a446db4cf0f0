#include "worker/render/bsdf.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "worker/render/sampler.h"

namespace lumifold::render {
namespace {

const Vec3 kUp = {0, 0, 1};

const AlbedoTable& Table() {
  static const AlbedoTable table;
  return table;
}

Vec3 DirectionAt(double cosine, double phi) {
  const double sine = std::sqrt(1 - cosine * cosine);
  return {static_cast<float>(sine * std::cos(phi)), static_cast<float>(sine * std::sin(phi)),
          static_cast<float>(cosine)};
}

Bsdf Make(const SurfaceMaterial& material, Vec3 wo) { return {material, Table(), kUp, kUp, wo}; }

Vec3 Total(const Bsdf& bsdf, const BsdfValue& value) {
  return bsdf.DiffuseAlbedo() * value.diffuse + value.specular;
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

std::vector<SurfaceMaterial> RoughMaterials() {
  std::vector<SurfaceMaterial> all;
  for (const float roughness : {0.25f, 0.5f, 0.8f, 1.0f}) {
    all.push_back(Plastic(roughness));
    all.push_back(Metal(roughness));
    SurfaceMaterial mixed = Metal(roughness);
    mixed.metallic = 0.5f;
    all.push_back(mixed);
  }
  return all;
}

std::string Describe(const SurfaceMaterial& m) {
  return "metallic " + std::to_string(m.metallic) + " roughness " + std::to_string(m.roughness);
}

/// Integrates `f(direction)` over the upper hemisphere by midpoints.
template <typename F>
double IntegrateHemisphere(const F& f) {
  constexpr int kCosines = 400;
  constexpr int kAngles = 400;
  double sum = 0;
  for (int i = 0; i < kCosines; ++i) {
    for (int j = 0; j < kAngles; ++j)
      sum += f(DirectionAt((i + 0.5) / kCosines, 2 * M_PI * (j + 0.5) / kAngles));
  }
  return sum * 2 * M_PI / (kCosines * kAngles);
}

/// Directions below the horizon are drawn and rejected; the density of the others must integrate to their
/// share.
TEST(Bsdf, DensityIntegratesToTheShareOfValidSamples) {
  constexpr uint32_t kSamples = 1 << 14;
  for (const SurfaceMaterial& material : RoughMaterials()) {
    for (const double cosine : {0.95, 0.6, 0.25}) {
      const Bsdf bsdf = Make(material, DirectionAt(cosine, 0.3));
      const double total = IntegrateHemisphere([&](Vec3 wi) {
        float pdf = 0;
        bsdf.Evaluate(wi, &pdf);
        return static_cast<double>(pdf);
      });
      double valid = 0;
      for (uint32_t i = 0; i < kSamples; ++i) {
        const Sampler sampler(3, 0, 0, 2 * i);
        if (bsdf.Sample(sampler.Get2D(0).x, sampler.Get2D(1)).valid) valid += 1.0 / kSamples;
      }
      EXPECT_NEAR(total, valid, 5e-3) << Describe(material);
    }
  }
}

TEST(Bsdf, IsReciprocal) {
  for (const SurfaceMaterial& material : RoughMaterials()) {
    const Vec3 a = DirectionAt(0.8, 0.2);
    const Vec3 b = DirectionAt(0.35, 2.1);
    float pdf = 0;
    const Bsdf from_a = Make(material, a);
    const Bsdf from_b = Make(material, b);
    const Vec3 ab = Total(from_a, from_a.Evaluate(b, &pdf)) / b.z;
    const Vec3 ba = Total(from_b, from_b.Evaluate(a, &pdf)) / a.z;
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(ab[i], ba[i], 2e-3f * ba[i]) << Describe(material);
  }
}

TEST(Bsdf, DiffuseLobeIsLossless) {
  for (const SurfaceMaterial& material : RoughMaterials()) {
    if (material.metallic == 1) continue;
    const Bsdf bsdf = Make(material, DirectionAt(0.7, 0));
    const double total = IntegrateHemisphere([&](Vec3 wi) {
      float pdf = 0;
      return static_cast<double>(bsdf.Evaluate(wi, &pdf).diffuse);
    });
    EXPECT_NEAR(total, 1, 2e-3) << Describe(material);
  }
}

TEST(Bsdf, NeverReflectsMoreThanArrives) {
  for (SurfaceMaterial material : RoughMaterials()) {
    material.base_color = {1, 1, 1};
    for (const double cosine : {0.95, 0.5, 0.15}) {
      const Bsdf bsdf = Make(material, DirectionAt(cosine, 0));
      const double total = IntegrateHemisphere([&](Vec3 wi) {
        float pdf = 0;
        return static_cast<double>(Total(bsdf, bsdf.Evaluate(wi, &pdf)).y);
      });
      EXPECT_LT(total, 1.01) << Describe(material) << " cosine " << cosine;
    }
  }
}

/// The mean weight of samples must be the integral of the lobes: sampling and evaluation tell the same story.
TEST(Bsdf, SamplingAgreesWithEvaluation) {
  constexpr uint32_t kSamples = 1 << 16;
  for (const SurfaceMaterial& material : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.6, 1));
    double sampled = 0;
    for (uint32_t i = 0; i < kSamples; ++i) {
      const Sampler sampler(3, 0, 0, 2 * i);
      const BsdfSample sample = bsdf.Sample(sampler.Get2D(0).x, sampler.Get2D(1));
      if (sample.valid) sampled += static_cast<double>(Total(bsdf, sample.weight).y);
    }
    const double integral = IntegrateHemisphere([&](Vec3 wi) {
      float pdf = 0;
      return static_cast<double>(Total(bsdf, bsdf.Evaluate(wi, &pdf)).y);
    });
    EXPECT_NEAR(sampled / kSamples, integral, 5e-3) << Describe(material);
  }
}

/// Pearson's test of the directions drawn against the density claimed, on a grid over the hemisphere.
TEST(Bsdf, DirectionsFollowTheirDensity) {
  constexpr int kRows = 12;
  constexpr int kColumns = 16;
  constexpr uint32_t kSamples = 200000;
  for (const SurfaceMaterial& material : RoughMaterials()) {
    const Bsdf bsdf = Make(material, DirectionAt(0.7, 0.5));
    std::vector<double> expected(kRows * kColumns, 0);
    constexpr int kFine = 24;
    for (int r = 0; r < kRows * kFine; ++r) {
      for (int c = 0; c < kColumns * kFine; ++c) {
        float pdf = 0;
        bsdf.Evaluate(DirectionAt((r + 0.5) / (kRows * kFine), 2 * M_PI * (c + 0.5) / (kColumns * kFine)),
                      &pdf);
        expected[(r / kFine) * kColumns + c / kFine] +=
            static_cast<double>(pdf) * 2 * M_PI / (kRows * kFine * kColumns * kFine);
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
      const int row = std::min(static_cast<int>(sample.wi.z * kRows), kRows - 1);
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
    // Beyond five standard deviations of chi-squared, plus what the midpoint rule may leave in steep cells.
    EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells) + 0.3 * cells) << Describe(material);
  }
}

TEST(Bsdf, GlassSplitsLightWithoutLoss) {
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
          sum += static_cast<double>(sample.weight.specular.y);
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

}  // namespace
}  // namespace lumifold::render
