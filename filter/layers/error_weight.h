#pragma once

namespace lumifold::filter {

/// Weight of a pixel's squared error in a mean over pixels: errors count relative to the light, as they are
/// seen, down to a part of the picture's mean. With equal weights one pixel at the rim of an emitter would
/// decide for all dark pixels around it. `light`: over the picture's mean, >= 0.
inline float ErrorWeight(float light) {
  constexpr float kDim = 0.3f;
  const float relative_to = light + kDim;
  return 1.0f / (relative_to * relative_to);
}

}  // namespace lumifold::filter
