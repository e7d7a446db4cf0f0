#pragma once

#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// Looks textures up: bilinear between texels (or nearest where the file asks), wrapped as the file says.
/// Threads: safe concurrently. Keeps a pointer to the scene, which must outlive it.
class TextureSampler {
 public:
  explicit TextureSampler(const scene::Scene& scene);

  /// Linear RGBA at uv sets uv0/uv1; `srgb` decodes the colour (never alpha). White where the reference names
  /// no texture.
  scene::Vec4 Sample(const scene::TextureRef& ref, const scene::Vec2 uv[2], bool srgb) const;

  /// The mean over all texels, white where there is no texture.
  scene::Vec3 Mean(const scene::TextureRef& ref, bool srgb) const;

 private:
  scene::Vec4 Texel(const scene::ImageData& image, int x, int y, bool srgb) const;

  const scene::Scene* scene_;
  float linear_[256];
  float srgb_[256];
};

}  // namespace lumifold::render
