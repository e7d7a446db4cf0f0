#include "worker/render/materials/lobes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "filter/image/mix_bits.h"
#include "worker/render/materials/bsdf.h"
#include "worker/render/tracing/surface.h"

namespace lumifold::render {
namespace {

using scene::Material;

/// Random factors, with 0 and 1 more often than others.
class Factors {
 public:
  float Next() {
    const uint64_t bits = MixBits(++count_);
    if (bits % 3 == 0) return 0;
    if (bits % 3 == 1) return 1;
    return static_cast<float>(bits >> 40) * 0x1p-24f;
  }

 private:
  uint64_t count_ = 0;
};

/// A texture of one texel, half of the time: each channel is another factor.
scene::TextureRef RandomTexture(Factors* next, scene::Scene* scene) {
  if (next->Next() < 0.5f) return {};
  scene::ImageData texel = {.width = 1, .height = 1, .rgba = {}};
  for (size_t channel = 0; channel < 4; ++channel)
    texel.rgba.push_back(static_cast<uint8_t>(255.0f * next->Next()));
  scene->textures.push_back({.image = static_cast<int>(scene->images.size())});
  scene->images.push_back(std::make_shared<const scene::ImageData>(std::move(texel)));
  return {.texture = static_cast<int>(scene->textures.size()) - 1};
}

Material RandomMaterial(Factors* next, scene::Scene* scene) {
  Material m;
  for (scene::TextureRef* texture :
       {&m.base.metallic_roughness_texture, &m.specular.factor_texture, &m.transmission.texture,
        &m.clearcoat.factor_texture, &m.clearcoat.roughness_texture})
    *texture = RandomTexture(next, scene);
  m.base.color = {next->Next(), next->Next(), next->Next()};
  m.base.metallic = next->Next();
  m.base.roughness = next->Next();
  m.specular.factor = next->Next();
  m.transmission.factor = next->Next();
  m.ior = 1.0f + 0.5f * next->Next();
  m.volume.is_solid = next->Next() > 0.5f;
  m.volume.dispersion = m.volume.is_solid && m.transmission.factor > 0 ? next->Next() : 0.0f;
  m.clearcoat.factor = next->Next();
  m.clearcoat.roughness = next->Next();
  m.sheen.color = Vec3{1, 1, 1} * (next->Next() > 0.5f ? 1.0f : 0.0f);
  m.sheen.roughness = next->Next();
  m.base.anisotropy.strength = next->Next();
  m.base.diffuse_transmission.factor = next->Next();
  m.iridescence.factor = next->Next();
  m.unlit = next->Next() * next->Next() * next->Next() == 1;
  return m;
}

// The renderer relies on LobesOf(): a lobe that a BSDF has must be in the set.
TEST(Lobes, NoLobeOfABsdfIsMissing) {
  Factors next;
  const AlbedoTable table(
      AlbedoTable::Contents{.anisotropic = true, .sheen = true, .glass_iors = {1.0f, 1.5f}});
  for (int i = 0; i < 400; ++i) {
    scene::Scene scene;
    scene.materials = {RandomMaterial(&next, &scene)};
    const Material& material = scene.materials[0];
    const TextureSampler textures(scene);
    const SurfaceReader reader(scene, textures);
    TextureRanges ranges(scene);
    const LobeSet lobes = LobesOf(material, &ranges);
    for (const bool front : {true, false}) {
      for (const float cosine : {0.02f, 0.3f, 0.8f, 1.0f}) {
        Surface surface;
        surface.material = &material;
        surface.front = front;
        surface.coat_normal = {0, 0, 1};
        surface.anisotropy = Vec3{0.6f, 0.8f, 0} * material.base.anisotropy.strength;
        const SurfaceMaterial values = reader.Shade(surface);
        const Bsdf bsdf(values, table, {0, 0, 1}, {0, 0, 1}, {std::sqrt(1.0f - cosine * cosine), 0, cosine});
        EXPECT_LE(bsdf.HasDiffuse(), lobes.diffuse) << i;
        EXPECT_LE(bsdf.DeltaProbability() > 0, lobes.delta) << i;
        EXPECT_LE(MaxComponent(bsdf.GlossyAlbedo()) > 0, lobes.glossy) << i;
        EXPECT_EQ(values.IsDiffuseOnly(), !lobes.glossy && !lobes.delta) << i;
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::render
