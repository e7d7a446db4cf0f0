#include "worker/render/materials/sheen.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

/// The exponent of the fitted masking function for cosines up to 1/2; interpolates the paper's table 1
/// between alpha = 0 (first value) and alpha = 1 (second value).
float MaskingExponent(float cosine, float alpha) {
  const float smooth = (1.0f - alpha) * (1.0f - alpha);
  const auto mix = [smooth](float at_zero, float at_one) { return at_one + (at_zero - at_one) * smooth; };
  const float a = mix(25.3245f, 21.5473f);
  const float b = mix(3.32435f, 3.82987f);
  const float c = mix(0.16801f, 0.19823f);
  const float d = mix(-1.27393f, -1.97760f);
  const float e = mix(-4.85967f, -4.32054f);
  return a / (1.0f + b * Pow(cosine, c)) + d * cosine + e;
}

float MaskingLambda(float cosine, float alpha) {
  if (cosine < 0.5f) return Exp(MaskingExponent(cosine, alpha));
  return Exp(2.0f * MaskingExponent(0.5f, alpha) - MaskingExponent(std::max(1.0f - cosine, 0.0f), alpha));
}

}  // namespace

float SheenLobe(Vec3 wi, Vec3 wo, float alpha) {
  const Vec3 h = Normalize(wi + wo);
  const float inverse_alpha = 1.0f / alpha;
  const float sine = std::sqrt(std::min(h.x * h.x + h.y * h.y, 1.0f));
  const float density = (2.0f + inverse_alpha) * Pow(sine, inverse_alpha) / (2.0f * kPi);
  const float masking = 1.0f / (1.0f + MaskingLambda(wi.z, alpha) + MaskingLambda(wo.z, alpha));
  return density * masking / (4.0f * wo.z);
}

}  // namespace lumifold::render
