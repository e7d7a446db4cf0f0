#pragma once

#include <algorithm>
#include <cmath>

#include "filter/layers/features.h"

namespace lumifold::filter {

// In a finer picture a surface covers more pixels. A mean over as many pixels can then take more similar ones
// and, where the light hardly varies, a mean over more pixels is as good. The exponents were measured from
// 128x128 to 1024x768 pixels (docs/results/filter-engine.md); larger pictures, and blocks of them, count as
// kLargestPicture.

inline constexpr float kLargestPicture = 1 << 20;  // px

/// Pixels of the picture, up to kLargestPicture, over `small`; at least 1.
inline float SizeRatio(int width, int height, float small) {
  const float pixels = static_cast<float>(width) * static_cast<float>(height);
  return std::max(1.0f, std::min(pixels, kLargestPicture) / small);
}

/// Factor on the second filtering's reach relative to a picture of 128x128: the fourth root of the ratio of
/// pixels, 1 to 2.83.
inline float ReachScale(int width, int height) {
  return std::sqrt(std::sqrt(SizeRatio(width, height, 128 * 128)));
}

/// Range of normals: kSigmaNormal up to 256x192 pixels, then divided by the eighth root of the ratio of
/// pixels, as the best width of a kernel falls with the density of what it averages; down to 0.2.
inline float SigmaNormal(int width, int height) {
  return kSigmaNormal / std::sqrt(std::sqrt(std::sqrt(SizeRatio(width, height, 256 * 192))));
}

}  // namespace lumifold::filter
