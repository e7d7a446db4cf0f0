#pragma once

namespace lumifold::filter {

/// Weight of a pixel's squared error in a mean over pixels: errors count relative to the light, as they are
/// seen, down to a part of the picture's mean. With equal weights one pixel at the rim of an emitter would
/// decide for all dark pixels around it. `light` >= 0 and `dim` > 0: over the picture's mean.
inline float ErrorWeight(float light, float dim) {
  const float relative_to = light + dim;
  return 1.0f / (relative_to * relative_to);
}

}  // namespace lumifold::filter
