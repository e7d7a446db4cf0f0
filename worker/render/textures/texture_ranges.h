#pragma once

#include <array>
#include <optional>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// The least and the greatest value that something takes.
struct ValueRange {
  float min = 1;
  float max = 1;

  /// The range of the product with a factor of at least 0.
  ValueRange operator*(float factor) const { return {min * factor, max * factor}; }
};

/// The values that textures take, from all their texels. Interpolated and averaged values lie in the same
/// range, but for rounding. Threads: one at a time. Keeps a pointer to the scene, which must outlive it.
class TextureRanges {
 public:
  explicit TextureRanges(const scene::Scene& scene) : scene_(&scene), known_(scene.images.size()) {}

  /// Of channel 0 to 3 (red, green, blue, alpha) as linear data in [0, 1]; {1, 1} if the reference names no
  /// texture.
  ValueRange Of(const scene::TextureRef& ref, size_t channel);

 private:
  const scene::Scene* scene_;
  std::vector<std::array<std::optional<ValueRange>, 4>> known_;  // by image and channel
};

}  // namespace lumifold::render
