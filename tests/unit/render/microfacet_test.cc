#include "worker/render/materials/microfacet.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

constexpr std::array<GgxAlpha, 4> kGgxAlphas = {GgxAlpha(0.2f), GgxAlpha(0.8f, 0.1f), GgxAlpha(1.0f, 0.3f),
                                                GgxAlpha(0.15f, 0.5f)};

Vec3 UpperDirection(double cosine, double phi) {
  const double sine = std::sqrt(1 - cosine * cosine);
  return {static_cast<float>(sine * std::cos(phi)), static_cast<float>(sine * std::sin(phi)),
          static_cast<float>(cosine)};
}

/// The integral of `f(direction)` over the upper hemisphere.
template <typename F>
double IntegrateHemisphere(const F& f) {
  constexpr int kCosines = 600;
  constexpr int kAngles = 200;
  double sum = 0;
  for (int i = 0; i < kCosines; ++i) {
    const double place = (i + 0.5) / kCosines;  // squared: most nodes where narrow lobes are
    for (int j = 0; j < kAngles; ++j)
      sum += f(UpperDirection(1 - place * place, 2 * M_PI * (j + 0.5) / kAngles)) * 2 * place;
  }
  return sum * 2 * M_PI / (kCosines * kAngles);
}

/// D_GGX_anisotropic and V_GGX_anisotropic as the text of KHR_materials_anisotropy has them, in double.
double DensityOfTheExtension(Vec3 h, GgxAlpha alpha) {
  const double at = double{alpha.x}, ab = double{alpha.y};
  const double a2 = at * ab;
  const double fx = ab * double{h.x}, fy = at * double{h.y}, fz = a2 * double{h.z};
  const double w2 = a2 / (fx * fx + fy * fy + fz * fz);
  return a2 * w2 * w2 / M_PI;
}

double VisibilityOfTheExtension(Vec3 wi, Vec3 wo, GgxAlpha alpha) {
  const auto stretched = [&](Vec3 w) {
    const double x = double{alpha.x} * double{w.x}, y = double{alpha.y} * double{w.y}, z = double{w.z};
    return std::sqrt(x * x + y * y + z * z);
  };
  return 0.5 / (double{wi.z} * stretched(wo) + double{wo.z} * stretched(wi));
}

TEST(Microfacet, IsTheExtensionsAnisotropicGgx) {
  for (const GgxAlpha alpha : kGgxAlphas) {
    for (const double phi : {0.0, 0.4, 1.2, M_PI / 2, 2.9}) {
      for (const double cosine : {0.999, 0.8, 0.3}) {
        const Vec3 wi = UpperDirection(cosine, phi);
        const Vec3 wo = UpperDirection(0.6, 1.1);
        const double density = DensityOfTheExtension(wi, alpha);
        EXPECT_NEAR(double{GgxDensity(wi, alpha)} / density, 1, 1e-5);
        EXPECT_NEAR(double{GgxVisibility(wi, wo, alpha)} / VisibilityOfTheExtension(wi, wo, alpha), 1, 1e-5);
      }
    }
  }
}

TEST(Microfacet, OfEqualAlphasIsIsotropicToTheBit) {
  const Vec3 wo = UpperDirection(0.45, 0.7);
  for (const float alpha : {0.01f, 0.3f, 0.77f}) {
    for (const double phi : {0.1, 2.0}) {
      const Vec3 w = UpperDirection(0.8, phi);
      const float a2 = alpha * alpha;
      const float t = a2 * w.z * w.z + w.x * w.x + w.y * w.y;
      EXPECT_EQ(GgxDensity(w, GgxAlpha(alpha)), a2 / (kPi * t * t));
      const float lambda_o = w.z * std::sqrt(wo.z * wo.z * (1.0f - a2) + a2);
      const float lambda_i = wo.z * std::sqrt(w.z * w.z * (1.0f - a2) + a2);
      EXPECT_EQ(GgxVisibility(w, wo, GgxAlpha(alpha)), 0.5f / (lambda_o + lambda_i));
    }
    EXPECT_EQ(GgxAlpha(alpha).Mean(), alpha);
  }
}

/// Microfacets cover the surface exactly once, seen along the normal and, those that are visible, from wo.
TEST(Microfacet, CoversTheSurfaceOnce) {
  for (const GgxAlpha alpha : kGgxAlphas) {
    EXPECT_NEAR(IntegrateHemisphere([&](Vec3 h) { return double{GgxDensity(h, alpha) * h.z}; }), 1, 2e-3);
    for (const double phi : {0.0, 0.8, M_PI / 2}) {
      const Vec3 wo = UpperDirection(0.5, phi);
      EXPECT_NEAR(IntegrateHemisphere([&](Vec3 h) { return double{GgxVisibleDensity(wo, h, alpha)}; }), 1,
                  3e-3);
    }
  }
}

/// The mean of f over sampled normals is its integral over their density.
TEST(Microfacet, SamplesNormalsByTheirVisibleDensity) {
  constexpr int kRoot = 256;
  for (const GgxAlpha alpha : kGgxAlphas) {
    for (const double phi : {0.0, 0.8, M_PI / 2}) {
      const Vec3 wo = UpperDirection(0.5, phi);
      const std::array<Vec3, 3> axes = {Vec3{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
      for (const Vec3 axis : axes) {
        const auto f = [&](Vec3 h) { return double{Dot(h, axis)} * double{Dot(h, axis)}; };
        double mean = 0;
        for (int i = 0; i < kRoot * kRoot; ++i) {
          const Vec2 u = {(static_cast<float>(i / kRoot) + 0.5f) / kRoot,
                          (static_cast<float>(i % kRoot) + 0.5f) / kRoot};
          mean += f(SampleGgxVisibleNormal(wo, alpha, ConcentricDisk(u))) / (kRoot * kRoot);
        }
        const double expected =
            IntegrateHemisphere([&](Vec3 h) { return f(h) * double{GgxVisibleDensity(wo, h, alpha)}; });
        EXPECT_NEAR(mean, expected, 3e-3) << alpha.x << " " << alpha.y << " " << phi;
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::render
