#include "worker/render/materials/thin_film.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace lumifold::render {
namespace {

/// The CIE 1931 colour matching functions over the wave number (1 / metre) as the paper fits them, each of
/// integral 1 but for the fit.
struct Response {
  double weight, place, variance;
  double At(double wave_number) const {
    const double offset = wave_number - place;
    return weight * std::exp(-offset * offset / (4 * variance)) / std::sqrt(4 * M_PI * variance);
  }
};

double WeightOf(double height, double variance) {
  return height * std::sqrt(2 * M_PI * variance) / 1.0685e-7;
}

const std::array<Response, 4> kResponses = {
    Response{WeightOf(5.4856e-13, 4.3278e9), 1.6810e6, 4.3278e9},
    Response{WeightOf(9.7470e-14, 4.5282e9), 2.2399e6, 4.5282e9},  // X too
    Response{WeightOf(4.4201e-13, 9.3046e9), 1.7953e6, 9.3046e9},
    Response{WeightOf(5.2481e-13, 6.6121e9), 2.2084e6, 6.6121e9}};

double AmplitudeOf(double from_ior, double to_ior, double cosine) {
  const double r0 = (from_ior - to_ior) / (from_ior + to_ior);
  const double r = r0 * r0 + (1 - r0 * r0) * std::pow(1 - cosine, 5);  // Schlick's reflectance
  return r0 < 0 ? -std::sqrt(r) : std::sqrt(r);
}

/// A film in air, of a base of this index.
struct Film {
  double thickness_nm, ior, base_ior;

  double CosineWithin(double cosine) const { return std::sqrt(1 - (1 - cosine * cosine) / (ior * ior)); }

  /// The reflectance at one wave number: all interreflections, summed by Airy.
  double At(double wave_number, double cosine) const {
    const double within = CosineWithin(cosine);
    const double a = AmplitudeOf(1, ior, cosine), b = AmplitudeOf(ior, base_ior, within);
    const double phase = std::cos(2 * M_PI * wave_number * 2 * ior * thickness_nm * 1e-9 * within);
    return (a * a + b * b + 2 * a * b * phase) / (1 + a * a * b * b + 2 * a * b * phase);
  }
  /// Its mean over all phases.
  double Mean(double cosine) const {
    const double a = AmplitudeOf(1, ior, cosine), b = AmplitudeOf(ior, base_ior, CosineWithin(cosine));
    return a * a + (1 - a * a) * (1 - a * a) * b * b / (1 - a * a * b * b);
  }
};

/// What the eye sees of `film` in light of equal energy, as linear Rec. 709: by summing over wave numbers.
std::array<double, 3> Seen(const Film& film, double cosine) {
  constexpr int kWaveNumbers = 4000;
  constexpr double kFirst = 0.8e6, kLast = 3.2e6;
  const double mean = film.Mean(cosine);
  std::array<double, 4> sums = {};
  for (int i = 0; i < kWaveNumbers; ++i) {
    const double k = kFirst + (kLast - kFirst) * (i + 0.5) / kWaveNumbers;
    const double difference = (film.At(k, cosine) - mean) * (kLast - kFirst) / kWaveNumbers;
    for (size_t r = 0; r < sums.size(); ++r) sums[r] += kResponses[r].At(k) * difference;
  }
  const double x = sums[0] + sums[1], y = sums[2], z = sums[3];
  return {mean + 3.2404542 * x - 1.5371385 * y - 0.4985314 * z,
          mean - 0.9692660 * x + 1.8760108 * y + 0.0415560 * z,
          mean + 0.0556434 * x - 0.2040259 * y + 1.0572252 * z};
}

float F0Of(double ior) {
  const double r = (ior - 1) / (ior + 1);
  return static_cast<float>(r * r);
}

/// The only differences are orders of interference above the second.
TEST(ThinFilm, IsTheSumOverTheSpectrum) {
  for (const double base_ior : {1.0, 1.5, 3.0}) {
    for (const double ior : {1.3, 1.8}) {
      for (const double thickness : {100.0, 350.0, 800.0, 5000.0}) {
        const Film film = {thickness, ior, base_ior};
        const float f0 = F0Of(base_ior);
        const ThinFilm fitted(static_cast<float>(thickness), static_cast<float>(ior), 1, {f0, f0, f0});
        for (const double cosine : {1.0, 0.7, 0.4}) {
          const std::array<double, 3> seen = Seen(film, cosine);
          const Vec3 got = fitted.Reflectance(static_cast<float>(cosine));
          for (int c = 0; c < 3; ++c) {
            EXPECT_NEAR(double{got[c]}, std::clamp(seen[static_cast<size_t>(c)], 0.0, 1.0), 0.012)
                << base_ior << " " << ior << " " << thickness << " " << cosine << " " << c;
          }
        }
      }
    }
  }
}

/// A film of the base's index is the base: there is nothing to interfere with.
TEST(ThinFilm, OfTheBasesIndexIsTheBase) {
  const float f0 = F0Of(1.5);
  const Vec3 got = ThinFilm(400, 1.5f, 1, {f0, f0, f0}).Reflectance(1);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(got[c], f0, 1e-6f);
}

/// Under a coat light arrives less steeply, and the film's outer face reflects less.
TEST(ThinFilm, UnderACoatOfItsIndexHasOneFace) {
  const float f0 = F0Of(2.0);
  const Vec3 got = ThinFilm(400, 1.5f, 1.5f, {f0, f0, f0}).Reflectance(1);
  const double r = (2.0 - 1.5) / (2.0 + 1.5);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(double{got[c]}, r * r, 1e-6);
}

TEST(ThinFilm, StaysWithinZeroAndOneForAnyValues) {
  for (const float thickness : {0.0f, 1.0f, 1e6f}) {
    for (const float ior : {1.0f, 1.33f, 1000.0f}) {
      for (const float f0 : {0.0f, 0.5f, 1.0f}) {
        for (const float cosine : {1e-4f, 0.5f, 1.0f}) {
          const Vec3 got = ThinFilm(thickness, ior, 1.5f, {f0, 0, 1}).Reflectance(cosine);
          for (int c = 0; c < 3; ++c) EXPECT_TRUE(got[c] >= 0 && got[c] <= 1) << thickness << " " << ior;
        }
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::render
