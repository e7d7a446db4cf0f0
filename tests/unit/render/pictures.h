#pragma once

#include <string_view>

#include <memory>

#include "filter/image/layered_image.h"
#include "worker/render/renderer.h"

/// Rendering small scenes whole, and looking at the result.
namespace lumifold::render {

RenderSettings SettingsOf(int width, int height, int max_bounces = 8);

std::unique_ptr<Renderer> MakeRenderer(scene::Scene scene, const RenderSettings& settings);

/// All samples [0, spp) of the whole frame; fails the test where one is not finite.
LayeredImage RenderAll(const Renderer& renderer, int width, int height, uint32_t spp);

/// Mean of one channel's layer over all pixels, halves together.
double MeanOf(const LayeredImage& sums, std::string_view layer, int component = 1);

}  // namespace lumifold::render
