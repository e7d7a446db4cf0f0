// What a surface takes of its triangle: all three corners count, whichever comes first.
#include "worker/render/tracing/surface.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>

namespace lumifold::render {
namespace {

using scene::Mesh;
using scene::Scene;

constexpr std::array<float, 3> kWeights = {0.5f, 0.3f, 0.2f};  // of the vertices, at the hit
constexpr float kConeWidth = 0.1f;

/// A triangle in the plane z = 0 that faces +Z; `first`: the vertex that its corners begin with.
Scene TriangleFrom(size_t first) {
  Scene scene;
  scene.materials.resize(1);
  Mesh mesh;
  mesh.material = 0;
  mesh.positions = {{0, 0, 0}, {2, 0, 0}, {0, 1, 0}};
  for (size_t c = 0; c < 3; ++c) mesh.triangles.push_back(static_cast<uint32_t>((first + c) % 3));
  scene.meshes.push_back(mesh);
  scene.instances.push_back({0, {}, ""});
  return scene;
}

Hit HitOf(size_t first, const std::array<float, 3>& weights) {
  Hit hit;
  hit.instance = 0;
  hit.u = weights[(first + 1) % 3];
  hit.v = weights[(first + 2) % 3];
  hit.distance = 1;
  hit.face_normal = {0, 0, 2};
  return hit;
}

template <typename T>
T Weighted(const std::array<T, 3>& values) {
  return values[0] * kWeights[0] + values[1] * kWeights[1] + values[2] * kWeights[2];
}

void ExpectNear(Vec3 actual, Vec3 expected) {
  EXPECT_NEAR(Length(actual - expected), 0, 1e-5f) << actual.x << " " << actual.y << " " << actual.z;
}
void ExpectNear(Vec2 actual, Vec2 expected) {
  EXPECT_NEAR(actual.x, expected.x, 1e-5f);
  EXPECT_NEAR(actual.y, expected.y, 1e-5f);
}

TEST(Surface, ReadsTheAttributesOfAllThreeCorners) {
  for (size_t first = 0; first < 3; ++first) {
    Scene scene = TriangleFrom(first);
    scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {128, 128, 255, 255}})};
    scene.textures = {{.image = 0}};
    scene.materials[0].base.color_texture.texture = 0;
    scene.materials[0].clearcoat.factor = 1;
    Mesh& mesh = scene.meshes[0];
    // u = x / 4 and v = 1 - y / 2 in the first set; twice u, and v, swapped in the second.
    mesh.uvs[0] = {{0, 1}, {0.5f, 1}, {0, 0.5f}};
    mesh.uvs[1] = {{1, 0}, {1, 1}, {0.5f, 0}};
    mesh.colors = {{1, 0, 0.5f, 1}, {0.2f, 0.4f, 0, 1}, {0, 1, 0.1f, 1}};
    const std::array<Vec3, 3> normals = {Normalize(Vec3{0.3f, 0, 1}), Normalize(Vec3{0, 0.4f, 1}),
                                         Normalize(Vec3{-0.5f, -0.1f, 1})};
    mesh.normals = {normals.begin(), normals.end()};
    const TextureSampler textures(scene);
    const SurfaceReader reader(scene, textures);
    Ray ray;  // from the left, half way down
    ray.direction = Normalize(Vec3{1, 0, -1});
    ray.width = kConeWidth;
    const Surface surface = reader.Read(HitOf(first, kWeights), ray);
    SCOPED_TRACE(first);
    ExpectNear(surface.uv[0], Weighted<Vec2>({mesh.uvs[0][0], mesh.uvs[0][1], mesh.uvs[0][2]}));
    ExpectNear(surface.uv[1], Weighted<Vec2>({mesh.uvs[1][0], mesh.uvs[1][1], mesh.uvs[1][2]}));
    ExpectNear(surface.vertex_color, Weighted<Vec3>({Vec3{1, 0, 0.5f}, {0.2f, 0.4f, 0}, {0, 1, 0.1f}}));
    ExpectNear(surface.normal, Normalize(Weighted<Vec3>(normals)));
    ExpectNear(surface.coat_normal, surface.normal);
    // The cone's section is longer along x, by the cosine, and as wide as the cone along y.
    const float length = kConeWidth * std::sqrt(2.0f);
    const auto& diameter = surface.footprint.diameter;
    ExpectNear(diameter[0][0], {length / 4, 0});
    ExpectNear(diameter[0][1], {0, -kConeWidth / 2});
    ExpectNear(diameter[1][0], {0, length / 2});
    ExpectNear(diameter[1][1], {-kConeWidth / 2, 0});
  }
}

TEST(Surface, TurnsItsAnisotropyFromTheTangent) {
  for (const bool front : {true, false}) {
    for (const float handedness : {1.0f, -1.0f}) {
      Scene scene = TriangleFrom(0);
      scene.meshes[0].normals.assign(3, {0, 0, 1});
      scene.meshes[0].tangents.assign(3, {0, 1, 0, handedness});
      scene.materials[0].base.anisotropy.strength = 0.5f;
      scene.materials[0].base.anisotropy.direction = {0.6f, 0.8f};
      const auto read = [&] {
        const TextureSampler textures(scene);
        const SurfaceReader reader(scene, textures);
        Ray ray;
        ray.direction = {0, 0, front ? -1.0f : 1.0f};
        const Surface surface = reader.Read(HitOf(0, kWeights), ray);
        EXPECT_EQ(reader.Shade(surface).rare.anisotropy, surface.anisotropy);
        return surface.anisotropy;
      };
      // The bitangent is -X, on either side.
      ExpectNear(read(), Vec3{-0.8f * handedness, 0.6f, 0} * 0.5f);
      // The texture's direction is its bitangent, and it has two thirds of the strength.
      scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {128, 255, 170, 255}})};
      scene.textures = {{.image = 0}};
      scene.materials[0].base.anisotropy.texture.texture = 0;
      EXPECT_NEAR(Length(read() - Vec3{-0.6f * handedness, -0.8f, 0} * (1.0f / 3)), 0, 3e-3f);
      scene.meshes[0].tangents.clear();
      EXPECT_EQ(read(), (Vec3{0, 0, 0}));
    }
  }
}

TEST(Surface, ReadsDiffuseTransmissionFromItsTextures) {
  Scene scene = TriangleFrom(0);
  scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {255, 0, 255, 51}})};
  scene.textures = {{.image = 0}};
  auto& transmission = scene.materials[0].base.diffuse_transmission;
  transmission.factor = 0.5f;
  transmission.color = {0.5f, 1, 0.25f};
  transmission.factor_texture.texture = transmission.color_texture.texture = 0;
  const TextureSampler textures(scene);
  const SurfaceReader reader(scene, textures);
  Ray ray;
  ray.direction = {0, 0, -1};
  const SurfaceMaterial values = reader.Shade(reader.Read(HitOf(0, kWeights), ray));
  EXPECT_NEAR(values.rare.diffuse_transmission, 0.1f, 1e-6f);
  ExpectNear(values.rare.diffuse_transmission_color, {0.5f, 0, 0.25f});
}

TEST(Surface, ReadsFilmsFromTheirTextures) {
  Scene scene = TriangleFrom(0);
  auto& film = scene.materials[0].iridescence;
  film.factor = 0.5f;
  film.ior = 1.7f;
  film.min_thickness_nm = 0;
  film.max_thickness_nm = 500;
  const auto read = [&scene] {
    const TextureSampler textures(scene);
    const SurfaceReader reader(scene, textures);
    Ray ray;
    ray.direction = {0, 0, -1};
    return reader.Shade(reader.Read(HitOf(0, kWeights), ray));
  };
  EXPECT_EQ(read().rare.film_thickness_nm, 500);
  EXPECT_EQ(read().rare.film_ior, 1.7f);
  EXPECT_EQ(read().rare.iridescence, 0.5f);
  scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {204, 51, 0, 0}})};
  scene.textures = {{.image = 0}};
  film.factor_texture.texture = film.thickness_texture.texture = 0;
  EXPECT_NEAR(read().rare.film_thickness_nm, 100, 1e-3f);
  EXPECT_NEAR(read().rare.iridescence, 0.4f, 1e-6f);
  scene.images = {std::make_shared<const scene::ImageData>(scene::ImageData{1, 1, {204, 0, 0, 0}})};
  EXPECT_EQ(read().rare.iridescence, 0) << "no thickness, no film";
}

TEST(Surface, OneCornersNormalMakesATriangleSmooth) {
  const Vec3 tilted = Normalize(Vec3{0.4f, 0.2f, 1});
  for (size_t first = 0; first < 3; ++first) {
    Scene scene = TriangleFrom(first);
    scene.meshes[0].normals.assign(3, {0, 0, 1});
    scene.meshes[0].normals[0] = tilted;
    const TextureSampler textures(scene);
    const SurfaceReader reader(scene, textures);
    Ray ray;
    ray.direction = {0, 0, -1};
    ExpectNear(reader.Read(HitOf(first, {1, 0, 0}), ray).normal, tilted);
    ExpectNear(reader.Read(HitOf(first, {0, 1, 0}), ray).normal, {0, 0, 1});
  }
}

}  // namespace
}  // namespace lumifold::render
