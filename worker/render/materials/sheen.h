#pragma once

#include "worker/render/sampling/frame.h"

/// The sheen of cloth: fibres that stand off the surface and are brightest at grazing angles. Directions are
/// in the shading frame (z = normal), on the upper side; alpha is the squared perceptual roughness.
/// Source: Estevez & Kulla 2017, "Production Friendly Microfacet Sheen BRDF".
namespace lumifold::render {

/// Minimum alpha. Below it the lobe is a rim thinner than a pixel and too steep for a table.
inline constexpr float kMinSheenAlpha = 1e-2f;

/// The lobe for a sheen colour of 1, times the cosine of wi, per steradian. alpha in [kMinSheenAlpha, 1].
float SheenLobe(Vec3 wi, Vec3 wo, float alpha);

}  // namespace lumifold::render
