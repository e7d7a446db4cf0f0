#include "worker/render/materials/opacity.h"

#include <gtest/gtest.h>

#include <array>
#include <memory>
#include <vector>

#include "worker/render/textures/texture_ranges.h"

namespace lumifold::render {
namespace {

using scene::AlphaMode;
using scene::Mesh;
using scene::Scene;

/// A triangle whose material has a picture of 2 x 1 texels with these alphas.
Scene TriangleOf(AlphaMode mode, std::array<uint8_t, 2> alpha) {
  Scene scene;
  scene.images = {std::make_shared<const scene::ImageData>(
      scene::ImageData{2, 1, {255, 255, 255, alpha[0], 255, 255, 255, alpha[1]}})};
  scene.textures = {{.image = 0, .nearest = true}};
  scene.materials.resize(1);
  scene.materials[0].alpha_mode = mode;
  scene.materials[0].base.color_texture.texture = 0;
  Mesh mesh;
  mesh.material = 0;
  mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {0, 1, 2};
  scene.meshes.push_back(mesh);
  return scene;
}

OpacityClass Scanned(const Scene& scene) {
  TextureRanges ranges(scene);
  return ScannedOpacityClassOf(scene, scene.meshes[0], &ranges);
}

/// The same with alpha `of_vertex` at one corner and 1 at the others, whichever corner it is.
OpacityClass Scanned(Scene scene, float of_vertex) {
  std::vector<OpacityClass> classes;
  for (size_t corner = 0; corner < 3; ++corner) {
    scene.meshes[0].colors.assign(3, {1, 1, 1, 1});
    scene.meshes[0].colors[corner].w = of_vertex;
    classes.push_back(Scanned(scene));
    EXPECT_EQ(classes[corner], classes[0]) << corner;
  }
  return classes[0];
}

TEST(ScannedOpacity, OfAMaskIsThatOfTheLeastProductOfMaterialTextureAndVertices) {
  const Scene full = TriangleOf(AlphaMode::kMask, {255, 255});
  EXPECT_EQ(OpacityClassOf(full, full.meshes[0]), OpacityClass::kMasked) << "by the settings alone";
  EXPECT_EQ(Scanned(full), OpacityClass::kOpaque);
  EXPECT_EQ(Scanned(full, 0.51f), OpacityClass::kOpaque);
  EXPECT_EQ(Scanned(full, 0.49f), OpacityClass::kMasked);
  for (const bool first : {true, false}) {
    Scene half = first ? TriangleOf(AlphaMode::kMask, {204, 255}) : TriangleOf(AlphaMode::kMask, {255, 204});
    EXPECT_EQ(Scanned(half, 0.64f), OpacityClass::kOpaque);
    EXPECT_EQ(Scanned(half, 0.61f), OpacityClass::kMasked);
    half.materials[0].base.alpha = 0.9f;
    EXPECT_EQ(Scanned(half, 0.71f), OpacityClass::kOpaque);
    EXPECT_EQ(Scanned(half, 0.68f), OpacityClass::kMasked);
    half.materials[0].alpha_cutoff = 0.4f;
    EXPECT_EQ(Scanned(half, 0.68f), OpacityClass::kOpaque);
  }
}

TEST(ScannedOpacity, OfAMaskWithACutoffAboveOneIsNothing) {
  Scene scene = TriangleOf(AlphaMode::kMask, {255, 255});
  scene.materials[0].alpha_cutoff = 1.5f;
  scene.materials[0].base.color_texture = {};
  EXPECT_EQ(Scanned(scene), OpacityClass::kMasked);
  EXPECT_EQ(OpacityClassOf(scene, scene.meshes[0]), OpacityClass::kMasked);
  EXPECT_EQ(OpacityAt(scene, scene.meshes[0], 0, 0, 0), 0);
}

TEST(ScannedOpacity, OfABlendIsOpaqueWhereNothingIsBelowOne) {
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kBlend, {255, 255})), OpacityClass::kOpaque);
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kBlend, {254, 255})), OpacityClass::kTransparent);
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kBlend, {255, 254})), OpacityClass::kTransparent);
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kBlend, {255, 255}), 0.9f), OpacityClass::kTransparent);
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kBlend, {255, 255}), 1), OpacityClass::kTransparent)
      << "sums of weights may lie below 1";
  EXPECT_EQ(Scanned(TriangleOf(AlphaMode::kOpaque, {0, 0}), 0), OpacityClass::kOpaque);
}

TEST(OpacityAt, IsThatOfTheThreeCornersAndTheTexelWhicheverCornerIsFirst) {
  Scene scene = TriangleOf(AlphaMode::kBlend, {51, 102});  // 0.2 and 0.4
  scene.materials[0].base.alpha = 0.5f;
  scene.materials[0].base.color_texture.uv_set = 1;
  Mesh& mesh = scene.meshes[0];
  mesh.colors = {{1, 1, 1, 1}, {1, 1, 1, 0.6f}, {1, 1, 1, 0.2f}};
  mesh.uvs[1] = {{0.1f, 0}, {0.3f, 0}, {0.9f, 0}};  // the third corner has the second texel
  const std::array<std::array<float, 3>, 4> weights = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5f, 0.2f, 0.3f}}};
  const std::array<float, 4> expected = {0.5f * 0.2f, 0.5f * 0.6f * 0.2f, 0.5f * 0.2f * 0.4f,
                                         0.5f * 0.68f * 0.2f};
  for (size_t first = 0; first < 3; ++first) {
    for (size_t c = 0; c < 3; ++c) mesh.triangles[c] = static_cast<uint32_t>((first + c) % 3);
    for (size_t i = 0; i < weights.size(); ++i) {
      EXPECT_NEAR(OpacityAt(scene, mesh, 0, weights[i][(first + 1) % 3], weights[i][(first + 2) % 3]),
                  expected[i], 1e-6f)
          << first << " " << i;
    }
  }
  scene.materials[0].alpha_mode = AlphaMode::kMask;
  scene.materials[0].alpha_cutoff = expected[1];
  EXPECT_EQ(OpacityAt(scene, mesh, 0, 1, 0), 1);  // of the second corner's successor, the first
  EXPECT_EQ(OpacityAt(scene, mesh, 0, 0, 1), 1) << "as much as the cutoff";
  EXPECT_EQ(OpacityAt(scene, mesh, 0, 0, 0), 0);
}

TEST(TextureRanges, AreThoseOfEachChannelOverAllTexels) {
  Scene scene;
  scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {1, 1, 1, 1}}),
                  std::make_shared<const scene::ImageData>(
                      scene::ImageData{3, 1, {51, 102, 204, 0, 0, 255, 153, 204, 153, 51, 102, 255}})};
  scene.textures = {{.image = 0}, {.image = 1}, {.image = scene::kNone}};
  TextureRanges ranges(scene);
  const std::array<std::array<float, 2>, 4> expected = {{{0, 0.6f}, {0.2f, 1}, {0.4f, 0.8f}, {0, 1}}};
  for (const bool again : {false, true}) {
    for (size_t channel = 0; channel < 4; ++channel) {
      const ValueRange range = ranges.Of({.texture = 1}, channel);
      EXPECT_FLOAT_EQ(range.min, expected[channel][0]) << channel << again;
      EXPECT_FLOAT_EQ(range.max, expected[channel][1]) << channel << again;
    }
  }
  for (const int texture : {scene::kNone, 2}) {
    EXPECT_EQ(ranges.Of({.texture = texture}, 0).min, 1);
    EXPECT_EQ(ranges.Of({.texture = texture}, 0).max, 1);
  }
}

}  // namespace
}  // namespace lumifold::render
