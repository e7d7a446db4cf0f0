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

/// Fails the test where the two pictures differ in a bit. A channel one of them lacks stands for zeros: units
/// carry no level that none of their pixels has reached.
void ExpectSameBits(const LayeredImage& a, const LayeredImage& b);

/// The part of a picture inside `rect`.
LayeredImage Cut(const LayeredImage& image, const Rect& rect);

/// Mean of one channel's layer over all pixels, halves together.
double MeanOf(const LayeredImage& sums, std::string_view layer, int component = 1);

}  // namespace lumifold::render
