#include "client/pictures/tone_curves.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lumifold::pictures {
namespace {

using Matrix = std::array<std::array<float, 3>, 3>;  // rows

/// Moves the primaries inwards, so that bright colours have somewhere to fade to; and back.
constexpr Matrix kInset = {{{0.842479062f, 0.0784336f, 0.0792237451f},
                            {0.0423282422f, 0.878468636f, 0.0791661275f},
                            {0.0423756549f, 0.0784336f, 0.879142974f}}};
constexpr Matrix kOutset = {{{1.19687901f, -0.0980208811f, -0.0990297441f},
                             {-0.0528968518f, 1.15190313f, -0.0989611768f},
                             {-0.0529716355f, -0.0980434501f, 1.15107367f}}};

void Multiply(const Matrix& matrix, float rgb[3]) {
  const float in[3] = {rgb[0], rgb[1], rgb[2]};
  for (size_t i = 0; i < 3; ++i) rgb[i] = matrix[i][0] * in[0] + matrix[i][1] * in[1] + matrix[i][2] * in[2];
}

/// The curve over the logarithm of light, from 16.5 stops, of which 0 is the darkest and 1 the brightest.
float AgXCurve(float x) {
  constexpr std::array<float, 7> kCoefficients = {-0.00232f, 0.1191f, 0.4298f, -6.868f,
                                                  31.96f,    -40.14f, 15.5f};
  float value = 0;
  for (size_t i = kCoefficients.size(); i-- > 0;) value = value * x + kCoefficients[i];
  return value;
}

}  // namespace

void AgX(float rgb[3]) {
  constexpr float kDarkest = -12.47393f, kBrightest = 4.026069f;  // logarithms to the base 2
  for (int c = 0; c < 3; ++c) rgb[c] = std::max(rgb[c], 0.0f);
  Multiply(kInset, rgb);
  for (int c = 0; c < 3; ++c) {
    const float stops = std::clamp(std::log2(std::max(rgb[c], 1e-10f)), kDarkest, kBrightest);
    rgb[c] = AgXCurve((stops - kDarkest) / (kBrightest - kDarkest));
  }
  Multiply(kOutset, rgb);
  constexpr float kDisplayGamma = 2.2f;
  for (int c = 0; c < 3; ++c) rgb[c] = std::pow(std::clamp(rgb[c], 0.0f, 1.0f), kDisplayGamma);
}

void PbrNeutral(float rgb[3]) {
  constexpr float kReflectance = 0.04f;  // at normal incidence
  constexpr float kShoulder = 0.8f - kReflectance;
  constexpr float kDesaturation = 0.15f;
  for (int c = 0; c < 3; ++c) rgb[c] = std::max(rgb[c], 0.0f);
  const float least = std::min({rgb[0], rgb[1], rgb[2]});
  const float offset = least < 2 * kReflectance ? least - least * least / (4 * kReflectance) : kReflectance;
  for (int c = 0; c < 3; ++c) rgb[c] -= offset;
  const float peak = std::max({rgb[0], rgb[1], rgb[2]});
  if (peak < kShoulder) return;
  constexpr float kRoom = 1 - kShoulder;
  const float compressed = 1 - kRoom * kRoom / (peak + kRoom - kShoulder);
  const float white = 1 - 1 / (kDesaturation * (peak - compressed) + 1);
  for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * (compressed / peak) * (1 - white) + compressed * white;
}

}  // namespace lumifold::pictures
