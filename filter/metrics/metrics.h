#pragma once

#include "filter/image/plane.h"

namespace lumifold::metrics {

/// MSE255: mean over pixels and channels of (255 (srgb(exposure x) - srgb(exposure r)))^2. The curve is
/// clamped to [0, 1]; values are not quantised.
/// Shapes:  picture, reference: W x H, 3 planes; at least one pixel, one size.
/// Units:   linear radiance; the result in squared 8-bit steps. NaN counts as black.
/// Threads: safe concurrently.
double Mse255(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// 10 log10(255^2 / Mse255), in dB; infinite for equal pictures.
double Psnr(const ConstColorView& picture, const ConstColorView& reference, float exposure = 1.0f);

/// Mean over pixels and channels of (x - r)^2 / (r^2 + 0.01), in linear light. Shapes as Mse255.
double RelMse(const ConstColorView& picture, const ConstColorView& reference);

/// RelMse without the 0.1 % of pixels (rounded down) with the largest error, which mostly are fireflies. A
/// pixel's error is the mean over its channels; NaN counts as the largest error. Shapes as Mse255.
double TrimmedRelMse(const ConstColorView& picture, const ConstColorView& reference);

}  // namespace lumifold::metrics
