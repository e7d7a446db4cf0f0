#include "worker/render/materials/thin_film.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"
#include "worker/render/materials/microfacet.h"

namespace lumifold::render {
namespace {

constexpr float kMaxBaseF0 = 0.9999f;  // of 1 the index would be infinite

float BetweenIors(float a, float b) {
  const float r = (a - b) / (a + b);
  return r * r;
}

float Schlick(float f0, float cosine) { return SchlickFresnel({f0, 0, 0}, {1, 0, 0}, cosine).x; }

/// The Fourier transform of the CIE 1931 colour matching functions at an optical path difference in metres,
/// as linear Rec. 709 of light of equal energy. The functions are sums of Gaussians of the wave number;
/// height, place and spread are the paper's fit.
Vec3 Sensitivity(float path) {
  constexpr float kFullyDamped = 3e-4f;  // no Gaussian is left
  const float phase = std::min(2 * kPi * path, kFullyDamped);
  const auto gaussian = [phase](float height, float place, float variance) {
    float sine = 0, cosine = 1;
    SinCos(place * phase, &sine, &cosine);
    return height * std::sqrt(2 * kPi * variance) * cosine * Exp(-variance * phase * phase);
  };
  constexpr float kScale = 1.0f / 1.0685e-7f;
  const float x =
      (gaussian(5.4856e-13f, 1.6810e6f, 4.3278e9f) + gaussian(9.7470e-14f, 2.2399e6f, 4.5282e9f)) * kScale;
  const float y = gaussian(4.4201e-13f, 1.7953e6f, 9.3046e9f) * kScale;
  const float z = gaussian(5.2481e-13f, 2.2084e6f, 6.6121e9f) * kScale;
  return {3.2404542f * x - 1.5371385f * y - 0.4985314f * z, -0.9692660f * x + 1.8760108f * y + 0.0415560f * z,
          0.0556434f * x - 0.2040259f * y + 1.0572252f * z};
}

}  // namespace

ThinFilm::ThinFilm(float thickness_nm, float film_ior, float outside_ior, Vec3 base_f0)
    : path_(2 * film_ior * thickness_nm * 1e-9f),
      film_ior_(film_ior),
      outside_ior_(outside_ior),
      outer_f0_(BetweenIors(film_ior, outside_ior)) {
  const bool outer_inverts = film_ior >= outside_ior;
  const auto set = [&](float f0, float* inner, float* sign) {
    const float root = std::sqrt(std::clamp(f0, 0.0f, kMaxBaseF0));
    const float base_ior = (1.0f + root) / (1.0f - root);
    *inner = BetweenIors(base_ior, film_ior);
    *sign = outer_inverts == (base_ior >= film_ior) ? 1.0f : -1.0f;
  };
  set(base_f0.x, &inner_f0_.x, &sign_.x);
  set(base_f0.y, &inner_f0_.y, &sign_.y);
  set(base_f0.z, &inner_f0_.z, &sign_.z);
}

Vec3 ThinFilm::Reflectance(float cosine) const {
  const auto cosine_within = [sine2 = 1.0f - cosine * cosine](float ior) {
    return std::sqrt(std::max(1.0f - sine2 / (ior * ior), 0.0f));
  };
  const float cos_film = cosine_within(film_ior_);
  const float outer = Schlick(outer_f0_, cosine_within(outside_ior_));
  const float through = 1.0f - outer;
  const float path = path_ * cos_film;
  const Vec3 first = Sensitivity(path);
  const Vec3 second = Sensitivity(2 * path);
  // An Airy sum as a Fourier series in the phase: mean, first and second order.
  const auto reflected = [&](float inner_f0, float sign, float s1, float s2) {
    const float inner = Schlick(inner_f0, cos_film);
    const float both = std::min(outer * inner, kMaxBaseF0);
    const float root = std::sqrt(both);
    const float star = through * through * inner / (1.0f - both);
    const float order = (through - star) * root * sign;
    const float sum = outer + star + 2.0f * order * (s1 - sign * root * s2);
    return std::clamp(sum, 0.0f, 1.0f);
  };
  return {reflected(inner_f0_.x, sign_.x, first.x, second.x),
          reflected(inner_f0_.y, sign_.y, first.y, second.y),
          reflected(inner_f0_.z, sign_.z, first.z, second.z)};
}

}  // namespace lumifold::render
