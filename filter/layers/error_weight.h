#pragma once

namespace lumifold::filter {

/// Weight of a squared error in a mean over pixels lit unlike: errors count relative to the light, as the
/// eye and every display take them, down to a part of the picture's mean. Counted alike they would let one
/// pixel on a lamp's rim decide what its dark neighbours become. `light`: over the mean, >= 0.
inline float ErrorWeight(float light) {
  constexpr float kDim = 0.3f;
  const float relative_to = light + kDim;
  return 1.0f / (relative_to * relative_to);
}

}  // namespace lumifold::filter
