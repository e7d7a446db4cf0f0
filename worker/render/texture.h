#pragma once

#include <vector>

#include "worker/render/mip_chain.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// What the cone round a ray covers of a surface: how far its two diameters reach in each set of texture
/// coordinates. All 0: a point.
struct Footprint {
  scene::Vec2 diameter[2][2];  // [uv set][one, the other]
};

/// Looks textures up: bilinear between texels (or nearest where the file asks), wrapped as the file says;
/// where texels are smaller than the footprint, the mean over it from smaller copies of the picture, made on
/// construction of all that the materials use. Threads: safe concurrently. Keeps a pointer to the scene,
/// which must outlive it. Source: Akenine-Moeller et al. 2021, "Improved Shader and Texture Level of Detail
/// Using Ray Cones" (footprint); Ewins et al. 1998 (several probes along the longer diameter).
class TextureSampler {
 public:
  explicit TextureSampler(const scene::Scene& scene);

  /// Linear RGBA at uv sets uv0/uv1; `srgb` decodes the colour (never alpha). White where the reference names
  /// no texture.
  scene::Vec4 Sample(const scene::TextureRef& ref, const scene::Vec2 uv[2], bool srgb) const {
    return Sample(ref, uv, Footprint{}, srgb);
  }
  scene::Vec4 Sample(const scene::TextureRef& ref, const scene::Vec2 uv[2], const Footprint& footprint,
                     bool srgb) const {
    if (ref.texture == scene::kNone) return {1, 1, 1, 1};
    return SampleImage(ref, uv, footprint, srgb);
  }

  /// The mean over all texels, white where there is no texture.
  scene::Vec3 Mean(const scene::TextureRef& ref, bool srgb) const;

 private:
  using Levels = std::vector<scene::ImageData>;  // the picture's half, its quarter, ...

  void Prepare(const scene::TextureUse& use);
  scene::Vec4 SampleImage(const scene::TextureRef& ref, const scene::Vec2 uv[2], const Footprint& footprint,
                          bool srgb) const;
  /// Between the two copies whose texels are nearest to `width` texels of the picture itself, at most the
  /// smallest one.
  scene::Vec4 SampleLevels(const scene::Texture& texture, scene::Vec2 uv, float width, bool srgb) const;
  scene::Vec4 Bilinear(const scene::ImageData& image, const scene::Texture& texture, scene::Vec2 uv,
                       bool srgb) const;
  scene::Vec4 Texel(const scene::ImageData& image, int x, int y, bool srgb) const;

  const scene::Scene* scene_;
  ByteCode linear_;
  ByteCode srgb_;
  std::vector<Levels> levels_[2];  // [srgb][image]
};

/// The alpha of a texture at uv between its texels, without any footprint; the reference must name one.
float SampleAlpha(const scene::Scene& scene, const scene::TextureRef& ref, scene::Vec2 uv);

}  // namespace lumifold::render
