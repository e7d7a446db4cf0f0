#pragma once

#include <string_view>

#include <memory>

#include "filter/image/layered_image.h"
#include "tests/charts/access/charts_access.h"
#include "worker/render/renderer.h"

/// Helpers that render small scenes and inspect the result.
namespace lumifold::render {

RenderSettings SettingsOf(int width, int height, int max_bounces = 8);

std::unique_ptr<Renderer> MakeRenderer(scene::Scene scene, const RenderSettings& settings,
                                       LightStrategy strategy = LightStrategy::kCombined);

/// The pass of samples [0, spp) of the whole frame; fails the test if one is not finite.
LayeredImage RenderAll(const Renderer& renderer, int width, int height, uint32_t spp);
/// The same by ChartsAccess::RenderRadiance.
LayeredImage RenderAllRadiance(const Renderer& renderer, int width, int height, uint32_t spp);

/// Fails the test if the two pictures differ in a bit. A missing channel stands for zeros: units omit levels
/// that none of their pixels reaches.
void ExpectSameBits(const LayeredImage& a, const LayeredImage& b);

/// The part of a picture within `rect`.
LayeredImage Cut(const LayeredImage& image, const Rect& rect);

/// Mean of one component of a layer over all samples of both halves.
double MeanOf(const LayeredImage& sums, std::string_view layer, int component = 1);

}  // namespace lumifold::render
