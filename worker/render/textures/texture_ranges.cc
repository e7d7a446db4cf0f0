#include "worker/render/textures/texture_ranges.h"

#include <algorithm>
#include <cstdint>

namespace lumifold::render {
namespace {

ValueRange RangeOf(const scene::ImageData& image, size_t channel) {
  uint8_t min = 255;
  uint8_t max = 0;
  for (size_t i = channel; i < image.rgba.size(); i += 4) {
    min = std::min(min, image.rgba[i]);
    max = std::max(max, image.rgba[i]);
  }
  return {static_cast<float>(min) / 255.0f, static_cast<float>(max) / 255.0f};
}

}  // namespace

ValueRange TextureRanges::Of(const scene::TextureRef& ref, size_t channel) {
  if (ref.texture == scene::kNone) return {};
  const int image = scene_->textures[ref.texture].image;
  if (image == scene::kNone || scene_->images[image]->rgba.empty()) return {};
  std::optional<ValueRange>& range = known_[image][channel];
  if (!range.has_value()) range = RangeOf(*scene_->images[image], channel);
  return *range;
}

}  // namespace lumifold::render
