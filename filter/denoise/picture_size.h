#pragma once

#include <algorithm>
#include <cmath>

#include "filter/layers/features.h"

namespace lumifold::filter {

// In a finer picture a surface covers more pixels, so that a mean over as many can be had of pixels that are
// more alike and, where the light hardly varies, over more. How far was measured from 128x128 to 1024x768
// pixels (docs/results/filter-engine.md); past that, blocks among them, all is as there.

/// Pixels over `small`, from 1 up to where measurements end.
inline float SizeRatio(int width, int height, float small) {
  constexpr float kLargest = 1 << 20;
  const float pixels = static_cast<float>(width) * static_cast<float>(height);
  return std::max(1.0f, std::min(pixels, kLargest) / small);
}

/// By how much the second filtering reaches farther than in a picture of 128x128: the fourth root of the
/// ratio of pixels, up to 2.8.
inline float ReachScale(int width, int height) {
  return std::sqrt(std::sqrt(SizeRatio(width, height, 128 * 128)));
}

/// Sigma of normals: kSigmaNormal up to 256x192 pixels, then by the eighth root of the ratio of pixels
/// less, as the best width of a kernel falls with the density of what it averages; down to .2.
inline float SigmaNormal(int width, int height) {
  return kSigmaNormal / std::sqrt(std::sqrt(std::sqrt(SizeRatio(width, height, 256 * 192))));
}

}  // namespace lumifold::filter
