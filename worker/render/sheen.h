#pragma once

#include "worker/render/frame.h"

/// The sheen of cloth: fibres that stand off the surface, and so shine where it is seen along. Directions are
/// in the shading frame (z = normal), on the upper side; alpha is the squared perceptual roughness.
/// Source: Estevez & Kulla 2017, "Production Friendly Microfacet Sheen BRDF".
namespace lumifold::render {

/// Below this alpha the lobe is a rim thinner than a pixel, and too steep to be tabled.
inline constexpr float kLeastSheenAlpha = 1e-2f;

/// The lobe of reflectance 1 times the cosine of wi, per steradian. alpha in [kLeastSheenAlpha, 1].
float SheenLobe(Vec3 wi, Vec3 wo, float alpha);

}  // namespace lumifold::render
