#pragma once

#include <algorithm>
#include <cmath>

#include "worker/render/sampling/frame.h"

namespace lumifold::render {

/// One wavelength of a path that glass disperses. Red, green and blue have bands that overlap, each with the
/// index that KHR_materials_dispersion gives the channel as its mean.
struct Wavelength {
  float shift = 0;          // of the index, in half its spread: -1 red's, 0 green's, 1 blue's
  Vec3 weight = {1, 1, 1};  // the channels' responses over their mean: 1 on average over all wavelengths

  /// `u` is a random number in [0, 1).
  static Wavelength Sample(float u) {
    const auto channel = std::min(static_cast<float>(static_cast<int>(3.0f * u)), 2.0f);
    const float v = 3.0f * u - channel;
    const float within =
        v < 0.5f ? std::sqrt(2.0f * v) - 1.0f : 1.0f - std::sqrt(std::max(2.0f - 2.0f * v, 0.0f));
    Wavelength out;
    out.shift = channel - 1.0f + within;
    const auto response = [&out](float center) {
      return std::max(1.0f - std::abs(out.shift - center), 0.0f);
    };
    const Vec3 responses = {response(-1), response(0), response(1)};
    constexpr float kMinResponse = 1e-6f;
    out.weight = responses * (3.0f / std::max(responses.x + responses.y + responses.z, kMinResponse));
    return out;
  }
};

/// The greatest shift of a wavelength, either way.
inline constexpr float kMaxShift = 2;

/// The index of glass of index `ior` at the d line; dispersion: 20 over its Abbe number, and so (ior - 1) /
/// 20 of it the spread of the index between the F and C lines.
inline float DispersedIor(float ior, float dispersion, float shift) {
  return std::max(ior + (ior - 1.0f) * 0.025f * dispersion * shift, 1.0f);
}

}  // namespace lumifold::render
