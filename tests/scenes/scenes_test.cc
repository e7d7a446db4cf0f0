#include "tests/scenes/scenes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiny_gltf.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <numbers>
#include <ostream>
#include <string>

#include "tests/scenes/glb_writer.h"
#include "tests/scenes/materials.h"
#include "tests/scenes/mesh_builder.h"
#include "tests/scenes/noise.h"

namespace lumifold::scenes {

void PrintTo(const SceneEntry& scene, std::ostream* out) { *out << scene.name; }

namespace {

using ::testing::HasSubstr;

tinygltf::Model Parse(const std::string& bytes) {
  tinygltf::Model model;
  tinygltf::TinyGLTF loader;
  std::string error, warning;
  const bool parsed = loader.LoadBinaryFromMemory(&model, &error, &warning,
                                                  reinterpret_cast<const unsigned char*>(bytes.data()),
                                                  static_cast<unsigned>(bytes.size()));
  EXPECT_TRUE(parsed);
  EXPECT_EQ(error, "");
  EXPECT_EQ(warning, "");
  return model;
}

/// The first byte of element `index`; fails the test if the element lies outside its view or the view outside
/// the buffer.
const unsigned char* Element(const tinygltf::Model& model, const tinygltf::Accessor& accessor,
                             std::size_t index, std::size_t element_bytes) {
  const tinygltf::BufferView& view = model.bufferViews.at(accessor.bufferView);
  EXPECT_LE((index + 1) * element_bytes, view.byteLength);
  EXPECT_LE(view.byteOffset + view.byteLength, model.buffers.at(0).data.size());
  return model.buffers[0].data.data() + view.byteOffset + index * element_bytes;
}

Vec3 ReadVec3(const tinygltf::Model& model, int accessor, std::size_t index) {
  std::array<float, 3> values;
  std::memcpy(values.data(), Element(model, model.accessors.at(accessor), index, sizeof(values)),
              sizeof(values));
  return {values[0], values[1], values[2]};
}

std::uint32_t ReadIndex(const tinygltf::Model& model, int accessor, std::size_t index) {
  const tinygltf::Accessor& a = model.accessors.at(accessor);
  const std::size_t bytes = a.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT ? 4 : 2;
  const unsigned char* at = Element(model, a, index, bytes);
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bytes; ++i) value |= static_cast<std::uint32_t>(at[i]) << (8 * i);
  return value;
}

/// Six times the volume inside a closed mesh: positive if its triangles face outwards.
double SixVolumes(const Mesh& mesh) {
  double sum = 0;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const auto corner = [&](std::size_t k) { return mesh.positions[mesh.indices[i + k]]; };
    sum += Dot(corner(0), Cross(corner(1), corner(2)));
  }
  return sum;
}

double Volume(const Mesh& mesh) { return SixVolumes(mesh) / 6; }

/// A scene as it is built and as it is read again: built once for all tests.
struct BuiltScene {
  SceneDescription scene;
  std::string bytes;
  tinygltf::Model model;
};

class EveryScene : public ::testing::TestWithParam<SceneEntry> {
 protected:
  static const BuiltScene& Built() {
    static std::map<std::string, BuiltScene> scenes;
    const auto [entry, is_new] = scenes.try_emplace(std::string(GetParam().name));
    if (is_new) {
      BuiltScene& built = entry->second;
      built.scene = GetParam().build();
      built.bytes = *EncodeGlb(built.scene);
      built.model = Parse(built.bytes);
    }
    return entry->second;
  }
};

INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, ::testing::ValuesIn(AllScenes().begin(), AllScenes().end()),
                         [](const auto& scene) {
                           std::string name;
                           for (const char c : scene.param.name) {
                             if (c != '-') name.push_back(c);
                           }
                           return name;
                         });

TEST_P(EveryScene, IsGlbThatTinygltfReadsWithoutWarnings) {
  const auto& [scene, bytes, model] = Built();
  EXPECT_LT(bytes.size(), std::size_t{4} << 20);
  EXPECT_EQ(model.nodes.size(), scene.nodes.size() + 1);
  EXPECT_EQ(model.meshes.size(), scene.meshes.size());
  ASSERT_EQ(model.images.size(), scene.textures.size());
  for (std::size_t i = 0; i < scene.textures.size(); ++i) {
    EXPECT_EQ(model.images[i].width, scene.textures[i].width) << scene.textures[i].name;
    EXPECT_EQ(model.images[i].height, scene.textures[i].height) << scene.textures[i].name;
  }
  for (const std::string& extension : model.extensionsUsed) {
    EXPECT_THAT(extension, ::testing::AnyOf("KHR_materials_emissive_strength", "KHR_materials_specular",
                                            "KHR_materials_transmission", "KHR_materials_unlit",
                                            "KHR_materials_volume"));
  }
  EXPECT_THAT(model.extensionsRequired, ::testing::IsEmpty());
}

TEST_P(EveryScene, HasOneFourByThreeCameraNamedCamera) {
  const tinygltf::Model& model = Built().model;
  ASSERT_EQ(model.cameras.size(), 1u);
  EXPECT_EQ(model.cameras[0].name, "camera");
  EXPECT_EQ(model.cameras[0].type, "perspective");
  EXPECT_DOUBLE_EQ(model.cameras[0].perspective.aspectRatio, 4.0 / 3.0);
  EXPECT_EQ(model.nodes.back().name, "camera");
  EXPECT_EQ(model.nodes.back().camera, 0);
}

TEST_P(EveryScene, HasIndicesInRangeAndUnitNormals) {
  const tinygltf::Model& model = Built().model;
  for (const tinygltf::Mesh& mesh : model.meshes) {
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const int normals = primitive.attributes.at("NORMAL");
      const std::size_t vertices = model.accessors.at(primitive.attributes.at("POSITION")).count;
      ASSERT_EQ(model.accessors.at(normals).count, vertices);
      std::size_t bad_normals = 0, bad_indices = 0;
      for (std::size_t i = 0; i < vertices; ++i) {
        bad_normals += !(std::fabs(Length(ReadVec3(model, normals, i)) - 1) < 1e-4);
      }
      for (std::size_t i = 0; i < model.accessors.at(primitive.indices).count; ++i) {
        bad_indices += ReadIndex(model, primitive.indices, i) >= vertices;
      }
      EXPECT_EQ(bad_normals, 0u) << mesh.name;
      EXPECT_EQ(bad_indices, 0u) << mesh.name;
    }
  }
}

TEST_P(EveryScene, HasPositionsInsideTheirStatedBounds) {
  const tinygltf::Model& model = Built().model;
  for (const tinygltf::Mesh& mesh : model.meshes) {
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const int positions = primitive.attributes.at("POSITION");
      const tinygltf::Accessor& accessor = model.accessors.at(positions);
      std::size_t outside = 0;
      for (std::size_t i = 0; i < accessor.count; ++i) {
        const Vec3 p = ReadVec3(model, positions, i);
        const double values[] = {p.x, p.y, p.z};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          outside += !(values[axis] >= accessor.minValues[axis] && values[axis] <= accessor.maxValues[axis]);
        }
      }
      EXPECT_EQ(outside, 0u) << mesh.name;
    }
  }
}

TEST_P(EveryScene, IsTheSameBytesOnEveryBuild) { EXPECT_EQ(*EncodeGlb(GetParam().build()), Built().bytes); }

TEST_P(EveryScene, HasTrianglesWhoseWindingAgreesWithTheirNormals) {
  for (const NamedMesh& mesh : Built().scene.meshes) {
    for (const auto& [part, material] : mesh.primitives) {
      std::size_t turned = 0;
      for (std::size_t i = 0; i < part.indices.size(); i += 3) {
        const std::uint32_t a = part.indices[i], b = part.indices[i + 1], c = part.indices[i + 2];
        const Vec3 face = Cross(part.positions[b] - part.positions[a], part.positions[c] - part.positions[a]);
        turned += !(Dot(face, part.normals[a] + part.normals[b] + part.normals[c]) > 0);
      }
      // A few differ at sharp creases in cloth.
      EXPECT_LE(turned, part.indices.size() / 3 / 200) << mesh.name;
    }
  }
}

TEST_P(EveryScene, IsLitByFewSingleSidedTriangles) {
  const SceneDescription& scene = Built().scene;
  EXPECT_EQ(scene.EmissiveTriangles() > 0, GetParam().name != "tiny-unlit");
  EXPECT_LE(scene.EmissiveTriangles(), 200);
  for (const Material& material : scene.materials) {
    EXPECT_FALSE(material.emission != Vec3{} && material.double_sided) << material.name;
  }
}

TEST_P(EveryScene, HasLightsThatEmitTowardsTheCamera) {
  const SceneDescription& scene = Built().scene;
  for (const Node& node : scene.nodes) {
    if (node.name == "lamp") continue;  // emits in all directions, or up
    for (const auto& [part, material] : scene.meshes[static_cast<std::size_t>(node.mesh)].primitives) {
      if (scene.materials[static_cast<std::size_t>(material)].emission == Vec3{}) continue;
      for (std::size_t i = 0; i < part.positions.size(); ++i) {
        const Vec3 to_camera = scene.camera.transform.translation - node.transform.Point(part.positions[i]);
        EXPECT_GT(Dot(node.transform.Normal(part.normals[i]), to_camera), 0) << node.name;
      }
    }
  }
}

TEST(Scenes, AreFoundByName) {
  EXPECT_EQ(AllScenes().size(), 12u);
  ASSERT_NE(FindScene("atrium"), nullptr);
  EXPECT_EQ(FindScene("atrium")->build, &BuildAtrium);
  EXPECT_EQ(FindScene("atrium.glb"), nullptr);
}

TEST(Atrium, HasManyTrianglesFromFewMeshes) {
  const SceneDescription scene = BuildAtrium();
  EXPECT_GE(scene.InstancedTriangles(), 100'000);
  EXPECT_LT(scene.UniqueTriangles(), scene.InstancedTriangles() / 4);
}

TEST(CornellBox, HasThePublishedMeasurements) {
  const SceneDescription scene = BuildCornellBox();
  const NamedMesh& light = scene.meshes.back();
  ASSERT_EQ(light.name, "light");
  const Vec3 expected[] = {
      {3.43, 5.488, 2.27}, {3.43, 5.488, 3.32}, {2.13, 5.488, 3.32}, {2.13, 5.488, 2.27}};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(Length(light.primitives[0].mesh.positions[i] - expected[i]), 0, 1e-9);
  }
  EXPECT_EQ(scene.InstancedTriangles(),
            2 * (5 + 3 + 5 + 5 + 1));  // the light's hole divides the ceiling into four quads
  EXPECT_NEAR(Length(scene.camera.transform.translation - Vec3{2.78, 2.73, -8}), 0, 1e-9);
  EXPECT_NEAR(std::tan(Radians(scene.camera.vertical_fov_degrees) / 2), 0.0125 / 0.035, 1e-6);
}

/// The largest height and the largest distance from the vertical through the origin.
Vec2 Reach(const Mesh& mesh) {
  Vec2 reach;
  for (const Vec3& p : mesh.positions)
    reach = {std::max(reach.x, Length(Vec2{p.x, p.z})), std::max(reach.y, p.y)};
  return reach;
}

TEST(Uplighter, LightsTheCeilingAlone) {
  const SceneDescription scene = BuildUplighter();
  const auto lamp = std::find_if(scene.nodes.begin(), scene.nodes.end(),
                                 [](const Node& node) { return node.name == "lamp"; });
  ASSERT_NE(lamp, scene.nodes.end());
  const NamedMesh& mesh = scene.meshes[static_cast<std::size_t>(lamp->mesh)];
  ASSERT_EQ(mesh.primitives.size(), 4u);
  const Vec2 rim = Reach(mesh.primitives[1].mesh), bulb = Reach(mesh.primitives[3].mesh);
  // The ray that leaves over the rim farthest from the vertical.
  const double spread = (rim.x + bulb.x) / (rim.y - bulb.y);
  EXPECT_LT(spread, std::tan(Radians(36)));
  constexpr double kCeiling = 2.7, kNearestWall = 0.95;
  EXPECT_LT(rim.x + (kCeiling - rim.y) * spread, kNearestWall);
}

TEST(Transform, LookingAtTurnsMinusZToTheTarget) {
  const Vec3 eye = {1, 2, 3};
  for (const Vec3 target : {Vec3{1, 2, -3}, Vec3{4, 1, 5}, Vec3{-4, 6, 3}, Vec3{1, 0, 9}}) {
    const Transform pose = Transform::LookingAt(eye, target);
    EXPECT_NEAR(Length(pose.Normal({0, 0, -1}) - Normalized(target - eye)), 0, 1e-12);
    EXPECT_NEAR(pose.Normal({1, 0, 0}).y, 0, 1e-12);
    EXPECT_GT(pose.Normal({0, 1, 0}).y, 0);
  }
}

TEST(MeshBuilder, ClosedShapesFaceOutwardsAndHoldTheirVolume) {
  constexpr double kPi = std::numbers::pi;
  Mesh box, rounded, cylinder, sphere, cushion;
  AddBox(box, {1, 2, 3}, {0.5, 2, 3});
  EXPECT_NEAR(Volume(box), 3, 1e-9);
  AddRoundedBox(rounded, {1, 2, 3}, {0.5, 2, 3}, 0.25, 8);
  // The Minkowski sum of a box and a ball: core, slabs, quarter cylinders and the ball.
  const double r = 0.25, a = 0, b = 1.5, c = 2.5;
  EXPECT_NEAR(Volume(rounded),
              2 * r * (a * b + b * c + c * a) + kPi * r * r * (a + b + c) + 4.0 / 3 * kPi * r * r * r, 0.01);
  AddCylinder(cylinder, {1, 0, 0}, 0.5, 0.25, 2, 256);
  EXPECT_NEAR(Volume(cylinder), kPi * 2 / 3 * (0.25 + 0.125 + 0.0625), 1e-3);
  AddSphere(sphere, {3, 0, 1}, 2, 128);
  EXPECT_NEAR(Volume(sphere), 4.0 / 3 * kPi * 8, 0.05);
  AddCushion(cushion, {0.7, 0.2, 0.5}, 1);
  EXPECT_GT(Volume(cushion), 0.3 * 0.7 * 0.2 * 0.5);
  EXPECT_LT(Volume(cushion), 0.7 * 0.2 * 0.5);
}

TEST(MeshBuilder, SphereIsSmoothAcrossSeamAndPoles) {
  Mesh sphere;
  AddSphere(sphere, {}, 1, 64);
  for (std::size_t i = 0; i < sphere.positions.size(); ++i) {
    EXPECT_NEAR(Length(sphere.normals[i] - sphere.positions[i]), 0, 0.01);
  }
}

TEST(MeshBuilder, LatheKeepsAHardEdgeWhereAPointIsGivenTwice) {
  Mesh cylinder;
  AddCylinder(cylinder, {}, 1, 1, 1, 32);
  for (const Vec3& normal : cylinder.normals) {
    EXPECT_TRUE(std::fabs(normal.y) > 0.999 || std::fabs(normal.y) < 0.001) << normal.y;
  }
}

TEST(Noise, RepeatsAfterItsPeriodAndStaysInRange) {
  for (int i = 0; i < 200; ++i) {
    const Vec2 p = {0.37 * i, 0.73 * i};
    const double value = Fbm(p, 4, 7, {8, 4});
    EXPECT_GE(value, 0);
    EXPECT_LE(value, 1);
    EXPECT_NEAR(value, Fbm(p + Vec2{8, 4}, 4, 7, {8, 4}), 1e-9);
  }
}

/// A valid scene of one triangle, which tests then invalidate.
SceneDescription OneTriangle() {
  SceneDescription scene{.name = "one-triangle"};
  const MaterialId material = scene.Add(Material{.name = "grey"});
  Mesh mesh;
  AddFlatPolygon(mesh, std::array{Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}});
  scene.PlaceOnce("triangle", {{mesh, material}});
  return scene;
}

TEST(EncodeGlb, WritesOneTriangle) {
  const tinygltf::Model model = Parse(*EncodeGlb(OneTriangle()));
  EXPECT_EQ(model.accessors.at(model.meshes.at(0).primitives.at(0).indices).count, 3u);
}

TEST(EncodeGlb, WritesSolidGlassWithAThickness) {
  SceneDescription scene = OneTriangle();
  scene.Add(Glass("pane"));
  scene.Add(SolidGlass("egg"));
  const tinygltf::Model model = Parse(*EncodeGlb(scene));
  EXPECT_EQ(model.materials.at(1).extensions.count("KHR_materials_volume"), 0u);
  const tinygltf::Value& volume = model.materials.at(2).extensions.at("KHR_materials_volume");
  EXPECT_GT(volume.Get("thicknessFactor").GetNumberAsDouble(), 0);
  EXPECT_EQ(model.materials.at(2).extensions.count("KHR_materials_transmission"), 1u);
}

TEST(EncodeGlb, NamesTheMeshWithAnIndexOutOfRange) {
  SceneDescription scene = OneTriangle();
  scene.meshes[0].primitives[0].mesh.indices[1] = 3;
  const absl::Status status = EncodeGlb(scene).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("mesh triangle: an index beyond vertex 2"));
}

TEST(EncodeGlb, RefusesIdsOfMissingObjects) {
  SceneDescription no_material = OneTriangle();
  no_material.meshes[0].primitives[0].material = MaterialId{1};
  EXPECT_THAT(std::string(EncodeGlb(no_material).status().message()), HasSubstr("no such material"));
  SceneDescription no_mesh = OneTriangle();
  no_mesh.nodes[0].mesh = MeshId{-1};
  EXPECT_THAT(std::string(EncodeGlb(no_mesh).status().message()), HasSubstr("no such mesh"));
  SceneDescription no_texture = OneTriangle();
  no_texture.materials[0].texture = TextureId{0};
  EXPECT_THAT(std::string(EncodeGlb(no_texture).status().message()), HasSubstr("no such texture"));
}

TEST(EncodeGlb, RefusesArraysOfDifferentLength) {
  SceneDescription scene = OneTriangle();
  scene.meshes[0].primitives[0].mesh.normals.pop_back();
  EXPECT_THAT(std::string(EncodeGlb(scene).status().message()), HasSubstr("unlike length"));
}

TEST(EncodeGlb, RefusesATextureWhosePixelsDoNotFitItsSize) {
  SceneDescription scene = OneTriangle();
  scene.Add(Texture{.name = "short", .width = 2, .height = 2, .rgb = {1, 2, 3}});
  EXPECT_THAT(std::string(EncodeGlb(scene).status().message()), HasSubstr("texture short"));
}

}  // namespace
}  // namespace lumifold::scenes
