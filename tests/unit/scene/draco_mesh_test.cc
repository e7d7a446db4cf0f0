#include "worker/scene/draco_mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/gltf_samples.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::HasSubstr;

nlohmann::json& ExtensionOf(GltfFixture* fixture) {
  return fixture->json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"];
}

class DracoMeshTest : public testing::TestWithParam<bool> {};

TEST_P(DracoMeshTest, RoundTrips) {
  const auto scene = DracoDocument(GetParam()).Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Mesh& mesh = scene->meshes[0];
  EXPECT_EQ(mesh.positions.size(), 4u);
  ASSERT_EQ(mesh.triangles.size(), 6u);
  float area = 0;
  for (size_t i = 0; i < 6; i += 3) {
    const Vec3 a = mesh.positions[mesh.triangles[i]];
    const Vec3 normal =
        Cross(mesh.positions[mesh.triangles[i + 1]] - a, mesh.positions[mesh.triangles[i + 2]] - a);
    EXPECT_GT(normal.z, 0);
    area += normal.z / 2;
  }
  EXPECT_NEAR(area, 1, 1e-3);
  ASSERT_EQ(mesh.uvs[0].size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(mesh.uvs[0][i].x, mesh.positions[i].x, 1e-3);
    EXPECT_NEAR(mesh.uvs[0][i].y, mesh.positions[i].y, 1e-3);
  }
}

TEST_P(DracoMeshTest, TruncationIsAnError) {
  GltfFixture fixture = DracoDocument(GetParam());
  const int length = fixture.json["bufferViews"][0]["byteLength"];
  for (int n = 0; n < length; ++n) {
    fixture.json["bufferViews"][0]["byteLength"] = n;
    EXPECT_THAT(ErrorOf(fixture), HasSubstr("mesh 0 primitive 0: KHR_draco_mesh_compression: ")) << n;
  }
}

TEST_P(DracoMeshTest, CountsAgainstTheLimits) {
  LoadOptions options;
  options.limits.max_triangles = 1;
  EXPECT_EQ(DracoDocument(GetParam()).Load(options).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST_P(DracoMeshTest, ReadsUncompressedAttributesFromTheirAccessors) {
  GltfFixture fixture = DracoDocument(GetParam());
  fixture.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] =
      fixture.AddFloats({1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0}, "VEC3");
  const auto scene = fixture.Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].colors[2].x, 1);
}

INSTANTIATE_TEST_SUITE_P(Methods, DracoMeshTest, testing::Bool(),
                         [](const auto& method) { return method.param ? "Edgebreaker" : "Sequential"; });

TEST(DracoMesh, NamesErrorsOfTheExtension) {
  GltfFixture attribute = DracoDocument(true);
  ExtensionOf(&attribute)["attributes"]["POSITION"] = 7;
  EXPECT_THAT(ErrorOf(attribute), HasSubstr("POSITION: Draco attribute 7 does not exist"));
  GltfFixture width = DracoDocument(true);
  ExtensionOf(&width)["attributes"]["POSITION"] = 1;
  EXPECT_THAT(ErrorOf(width), HasSubstr("POSITION: Draco attribute 1 has 2 components, not 3"));
  GltfFixture view = DracoDocument(true);
  ExtensionOf(&view)["bufferView"] = 5;
  EXPECT_THAT(ErrorOf(view), HasSubstr("buffer view 5 does not exist"));
  GltfFixture missing = DracoDocument(true);
  ExtensionOf(&missing).erase("attributes");
  EXPECT_THAT(ErrorOf(missing), HasSubstr("needs a bufferView and attributes"));
}

TEST(DracoMesh, RefusesValuesOfATypeThatGltfDoesNotHave) {
  constexpr char kFloat32 = 9;
  constexpr char kBool = 11;
  GltfFixture fixture = DracoDocument(false);
  const std::string uv_head{'\x03', kFloat32, 2};
  const size_t at = fixture.binary.find(uv_head);
  ASSERT_NE(at, std::string::npos);
  fixture.binary[at + 1] = kBool;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("TEXCOORD_0: Draco attribute 1 is of a type that glTF does not"));
}

TEST(DracoMesh, NamesErrorsOfTheHeader) {
  const auto with = [](size_t at, char value) {
    GltfFixture fixture = DracoDocument(true);
    fixture.binary[fixture.binary.find("DRACO") + at] = value;
    return ErrorOf(fixture);
  };
  EXPECT_THAT(with(0, 'X'), HasSubstr("not Draco data"));
  EXPECT_THAT(with(6, 1), HasSubstr("Draco bitstream 2.1, only 2.2 is read"));
  EXPECT_THAT(with(7, 0), HasSubstr("not a mesh"));
  EXPECT_THAT(with(8, 9), HasSubstr("unknown encoding"));
  EXPECT_THAT(with(10, '\x80'), HasSubstr("Draco metadata is not supported"));
}

}  // namespace
}  // namespace lumifold::scene
