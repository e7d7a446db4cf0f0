#pragma once

namespace lumifold {

/// The sRGB transfer curve (IEC 61966-2-1) from linear light to display value, both in [0, 1]. Values outside
/// are clamped; NaN gives 0.
float SrgbFromLinear(float linear);

/// The inverse of SrgbFromLinear.
float LinearFromSrgb(float encoded);

/// Rec. 709 luminance of linear RGB.
constexpr float Luminance(float r, float g, float b) { return 0.2126f * r + 0.7152f * g + 0.0722f * b; }

}  // namespace lumifold
