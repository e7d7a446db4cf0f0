#pragma once

#include <cmath>

namespace lumifold::filter {

struct RegressionParams {
  float sigma_px = 4;        // of a sample's weight by its distance in the picture; windows reach 1.5 sigma
  float sigma_light = 0.3f;  // of its weight by F, stabilised
  float slope = 4;  // deviation of a slope's prior: over a term's unit, light changes by so many times F
};

inline int WindowRadius(const RegressionParams& params) {
  return static_cast<int>(std::lround(1.5f * params.sigma_px));
}

/// Radius in pixels of what a pixel of a regression depends on.
inline int RegressionWindow(const RegressionParams& params) { return 2 * WindowRadius(params); }

}  // namespace lumifold::filter
