#pragma once

#include <vector>

#include "worker/render/textures/mip_chain.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// The elliptical footprint of a ray's cone on a surface: its two diameters in each set of texture
/// coordinates. All 0: a point.
struct Footprint {
  scene::Vec2 diameter[2][2];  // [uv set][first, second]
};

/// Texture lookup with the file's wrap modes: bilinear (or nearest, if the file says so) for footprints of at
/// most a texel, else the mean over the footprint from mip levels. The constructor gets the mip levels of
/// all textures that materials use. Threads: safe concurrently. Keeps a pointer to the scene, which must
/// outlive it. Source: Akenine-Moeller et al. 2021, "Improved Shader and Texture Level of Detail Using Ray
/// Cones" (footprint); Ewins et al. 1998 (several probes along the longer diameter).
class TextureSampler {
 public:
  /// `mips` is used by the constructor only; empty: MakeMips.
  explicit TextureSampler(const scene::Scene& scene, const MipSource& mips = {});

  /// Linear RGBA at the coordinates of both uv sets; `srgb` decodes the colour, and alpha is 1. White if the
  /// reference names no texture.
  scene::Vec4 Sample(const scene::TextureRef& ref, const scene::Vec2 uv[2], bool srgb) const {
    return Sample(ref, uv, Footprint{}, srgb);
  }
  scene::Vec4 Sample(const scene::TextureRef& ref, const scene::Vec2 uv[2], const Footprint& footprint,
                     bool srgb) const {
    if (ref.texture == scene::kNone) return {1, 1, 1, 1};
    return SampleImage(ref, uv, footprint, srgb);
  }

  /// The mean over all texels; white if there is no texture.
  scene::Vec3 Mean(const scene::TextureRef& ref, bool srgb) const;

 private:
  void Prepare(const scene::TextureUse& use, const MipSource& mips);
  scene::Vec4 SampleImage(const scene::TextureRef& ref, const scene::Vec2 uv[2], const Footprint& footprint,
                          bool srgb) const;

  const scene::Scene* scene_;
  TransferTable srgb_;
  std::vector<SharedMips> levels_[2];  // [srgb][image]
};

/// The alpha of a texture at uv, bilinear and without footprint; the reference must name a texture.
float SampleAlpha(const scene::Scene& scene, const scene::TextureRef& ref, scene::Vec2 uv);

}  // namespace lumifold::render
