#pragma once

#include "absl/status/statusor.h"
#include "filter/image/plane.h"

namespace lumifold::metrics {

/// Structural similarity of the displayed luminance (the sRGB curve of exposure * light, in [0, 1]): the mean
/// over all 11x11 windows (Gaussian, sigma 1.5) that lie within the picture. Equal pictures give 1.
/// Shapes:  picture, reference: W x H, 3 planes, one size.
/// Errors:  kInvalidArgument for a picture smaller than one window.
/// Threads: safe concurrently.
/// Source:  Wang, Bovik, Sheikh & Simoncelli 2004, C1 = 0.01^2, C2 = 0.03^2.
absl::StatusOr<double> Ssim(const ConstColorView& picture, const ConstColorView& reference,
                            float exposure = 1.0f);

/// Multi-scale SSIM: the product of contrast and structure over five scales, each half the size of the last,
/// and of luminance at the last, to the powers .0448 .2856 .3001 .2363 .1333. A scale whose mean is negative
/// counts as 0.
/// Errors:  kInvalidArgument for a picture with a side below 176 pixels, one window at the last scale.
/// Source:  Wang, Simoncelli & Bovik 2003.
absl::StatusOr<double> MsSsim(const ConstColorView& picture, const ConstColorView& reference,
                              float exposure = 1.0f);

}  // namespace lumifold::metrics
