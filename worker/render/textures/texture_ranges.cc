#include "worker/render/textures/texture_ranges.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

namespace lumifold::render {
namespace {

template <typename Code>
ValueRange RangeOf(const std::vector<Code>& codes, size_t channel) {
  constexpr Code kMost = std::numeric_limits<Code>::max();
  Code min = kMost;
  Code max = 0;
  for (size_t i = channel; i < codes.size(); i += 4) {
    min = std::min(min, codes[i]);
    max = std::max(max, codes[i]);
  }
  return {static_cast<float>(min) / float{kMost}, static_cast<float>(max) / float{kMost}};
}

}  // namespace

ValueRange TextureRanges::Of(const scene::TextureRef& ref, size_t channel) {
  if (ref.texture == scene::kNone) return {};
  const int image = scene_->textures[ref.texture].image;
  if (image == scene::kNone) return {};
  const scene::ImageData& picture = *scene_->images[image];
  if (picture.bytes() == 0) return {};
  std::optional<ValueRange>& range = known_[image][channel];
  if (!range.has_value())
    range = picture.is_deep() ? RangeOf(picture.rgba16, channel) : RangeOf(picture.rgba, channel);
  return *range;
}

}  // namespace lumifold::render
