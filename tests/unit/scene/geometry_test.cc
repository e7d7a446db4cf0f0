#include "worker/scene/geometry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>

#include "tests/support/gltf_fixture.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::vector<float> kFiveVertices = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0};

TEST(Geometry, ReadsATriangleWithoutIndices) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.meshes.size(), 1u);
  EXPECT_THAT(scene.meshes[0].triangles, ElementsAre(0u, 1u, 2u));
  EXPECT_THAT(scene.meshes[0].normals, IsEmpty()) << "no normals in the file: flat";
  EXPECT_EQ(scene.meshes[0].material, kNone);
}

TEST(Geometry, ConvertsStripsWithTheirWinding) {
  GltfFixture fixture;
  fixture.AddTriangles(kFiveVertices, {{"mode", 5}});
  EXPECT_THAT(MustLoad(fixture).meshes[0].triangles, ElementsAre(0u, 1u, 2u, 1u, 3u, 2u, 2u, 3u, 4u));
}

TEST(Geometry, ConvertsFans) {
  GltfFixture fixture;
  fixture.AddTriangles({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, {{"mode", 6}});
  EXPECT_THAT(MustLoad(fixture).meshes[0].triangles, ElementsAre(1u, 2u, 0u, 2u, 3u, 0u));
}

TEST(Geometry, LeavesOutPointsAndLinesWithAWarning) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle, {{"mode", 0}});
  fixture.AddTriangles(kTriangle, {{"mode", 3}});
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(scene.meshes, IsEmpty());
  EXPECT_THAT(scene.warnings,
              Contains("primitives of points or lines left out: 2 (the first in mesh 0 primitive 0)"));
}

TEST(Geometry, PositionsHaveRoomForOneMoreSoThatEmbreeCanShareThem) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  const Scene scene = MustLoad(fixture);
  EXPECT_GT(scene.meshes[0].positions.capacity(), 3u);
}

TEST(Geometry, DropsAndCountsDegenerateTriangles) {
  GltfFixture fixture;
  const int indices = fixture.AddIndices({0, 1, 2, 0, 0, 1, 1, 3, 2, 0, 2, 4});
  fixture.AddTriangles(kFiveVertices, {{"indices", indices}});
  const Scene scene = MustLoad(fixture);
  // The second repeats a vertex, the last has collinear vertices; vertex 4 is unused without it.
  EXPECT_THAT(scene.meshes[0].triangles, ElementsAre(0u, 1u, 2u, 1u, 3u, 2u));
  EXPECT_EQ(scene.meshes[0].positions.size(), 4u);
  EXPECT_THAT(scene.warnings,
              Contains("triangles without area dropped: 2 (the first in mesh 0 primitive 0)"));
}

TEST(Geometry, LeavesOutAMeshThatIsAllDegenerate) {
  GltfFixture fixture;
  fixture.AddTriangles({0, 0, 0, 1, 0, 0, 2, 0, 0});
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(scene.meshes, IsEmpty());
  EXPECT_THAT(scene.instances, IsEmpty());
  EXPECT_THAT(scene.warnings, Contains("no triangles: there is nothing to see"));
}

TEST(Geometry, KeepsOnlyVerticesThatTrianglesUse) {
  GltfFixture fixture;
  const int indices = fixture.AddIndices({4, 1, 3});
  const int uvs = fixture.AddFloats({0, 0, 1, 1, 2, 2, 3, 3, 4, 4}, "VEC2");
  fixture.AddTriangles(kFiveVertices, {{"indices", indices}, {"attributes", {{"TEXCOORD_1", uvs}}}});
  const Mesh mesh = MustLoad(fixture).meshes[0];
  EXPECT_THAT(mesh.positions, ElementsAre(Vec3{1, 0, 0}, Vec3{1, 1, 0}, Vec3{0, 2, 0}));
  EXPECT_THAT(mesh.triangles, ElementsAre(2u, 0u, 1u));
  ASSERT_EQ(mesh.uvs[1].size(), 3u);
  EXPECT_EQ(mesh.uvs[1][2].x, 4);
  EXPECT_THAT(mesh.uvs[0], IsEmpty());
}

TEST(Geometry, GivesNormalsAndTangentsUnitLength) {
  GltfFixture fixture;
  const int normals = fixture.AddFloats({0, 0, 2, 0, 0, 1e-30f, 0, 3e38f, 0}, "VEC3");
  const int tangents = fixture.AddFloats({4, 0, 0, 1, 0, 2, 0, -1, 0, 0, 0, 1}, "VEC4");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"NORMAL", normals}, {"TANGENT", tangents}}}});
  const Mesh mesh = MustLoad(fixture).meshes[0];
  EXPECT_THAT(mesh.normals, ElementsAre(Vec3{0, 0, 1}, Vec3{0, 0, 1}, Vec3{0, 1, 0}));
  EXPECT_EQ(mesh.tangents[0].x, 1);
  EXPECT_EQ(mesh.tangents[0].w, 1);
  EXPECT_EQ(mesh.tangents[1].y, 1);
  EXPECT_EQ(mesh.tangents[1].w, -1);
  const Vec3 made_up = {mesh.tangents[2].x, mesh.tangents[2].y, mesh.tangents[2].z};
  EXPECT_NEAR(Length(made_up), 1, 1e-6);
  EXPECT_NEAR(Dot(made_up, mesh.normals[2]), 0, 1e-6);
}

TEST(Geometry, ReplacesZeroNormalsByThoseOfTheFaces) {
  GltfFixture fixture;
  const int normals = fixture.AddFloats({0, 0, 0, 0, 1, 0, 0, 0, 0}, "VEC3");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"NORMAL", normals}}}});
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(scene.meshes[0].normals, ElementsAre(Vec3{0, 0, 1}, Vec3{0, 1, 0}, Vec3{0, 0, 1}));
  EXPECT_THAT(scene.warnings,
              Contains("normals of length zero replaced: 2 (the first in mesh 0 primitive 0)"));
}

TEST(Geometry, ClampsVertexColors) {
  GltfFixture fixture;
  const int colors = fixture.AddFloats({0.5f, 1, 0, 3, 0, -1, 1, 1, 1}, "VEC3");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"COLOR_0", colors}}}});
  const Scene scene = MustLoad(fixture);
  EXPECT_EQ(scene.meshes[0].colors[0].x, 0.5f);
  EXPECT_EQ(scene.meshes[0].colors[1].x, 1);
  EXPECT_EQ(scene.meshes[0].colors[1].z, 0);
  EXPECT_THAT(scene.warnings,
              Contains("vertex colours outside 0 to 1 clamped: 1 (the first in mesh 0 primitive 0)"));
}

TEST(Geometry, IgnoresTangentsWithoutNormals) {
  GltfFixture fixture;
  const int tangents = fixture.AddFloats({1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1}, "VEC4");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"TANGENT", tangents}}}});
  EXPECT_THAT(MustLoad(fixture).meshes[0].tangents, IsEmpty());
}

/// A triangle whose u runs along +Y, of an anisotropic material.
GltfFixture BrushedTriangle() {
  GltfFixture fixture;
  fixture.Add("materials", {{"extensions", {{"KHR_materials_anisotropy", {{"anisotropyStrength", 0.5}}}}}});
  fixture.AddTriangles(kTriangle, {{"material", 0}});
  return fixture;
}

TEST(Geometry, GeneratesTangentsForAnisotropy) {
  GltfFixture fixture = BrushedTriangle();
  const int uvs = fixture.AddFloats({0, 0, 0, 1, 1, 0}, "VEC2");
  fixture.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uvs;
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.meshes[0].tangents.size(), 3u);
  EXPECT_NEAR(scene.meshes[0].tangents[0].y, 1, 1e-6);
}

TEST(Geometry, CountsAnisotropicMeshesWithoutTangents) {
  EXPECT_THAT(
      MustLoad(BrushedTriangle()).warnings,
      Contains("meshes without tangents and texture coordinates have round highlights: 1 (the first in "
               "mesh 0 primitive 0)"));
}

TEST(Geometry, MakesAMeshOfEachPrimitive) {
  GltfFixture fixture;
  fixture.Add("materials", {{"name", "red"}});
  fixture.AddTriangles(kTriangle);
  nlohmann::json second = fixture.json["meshes"][0]["primitives"][0];
  second["material"] = 0;
  fixture.json["meshes"][0]["primitives"].push_back(second);
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.meshes.size(), 2u);
  EXPECT_EQ(scene.meshes[0].material, kNone);
  EXPECT_EQ(scene.meshes[1].material, 0);
  ASSERT_EQ(scene.instances.size(), 2u);
  EXPECT_EQ(scene.instances[1].mesh, 1);
}

TEST(Geometry, RefusesIndicesOutOfRange) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle, {{"indices", fixture.AddIndices({0, 1, 3})}});
  fixture.json["meshes"][0]["name"] = "Chair";
  EXPECT_EQ(ErrorOf(fixture),
            "test.glb: mesh 0 \"Chair\" primitive 0: index 3 at position 2 is out of range (3 vertices)");
}

TEST(Geometry, RefusesAttributesOfAnotherLength) {
  GltfFixture fixture;
  const int uvs = fixture.AddFloats({0, 0, 1, 1}, "VEC2");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"TEXCOORD_0", uvs}}}});
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("mesh 0 primitive 0: TEXCOORD_0: 2 elements for 3 vertices"));
}

TEST(Geometry, RefusesUnknownModesAndMaterials) {
  GltfFixture mode;
  mode.AddTriangles(kTriangle, {{"mode", 9}});
  EXPECT_THAT(ErrorOf(mode), HasSubstr("mesh 0 primitive 0: mode 9 is not glTF's"));
  for (const int material : {0, -2}) {
    GltfFixture fixture;
    fixture.AddTriangles(kTriangle, {{"material", material}});
    EXPECT_THAT(ErrorOf(fixture), HasSubstr("does not exist (there are 0)"));
  }
}

TEST(Geometry, RefusesMoreTrianglesThanTheLimit) {
  GltfFixture fixture;
  fixture.AddTriangles(kFiveVertices, {{"mode", 5}});
  fixture.AddTriangles(kTriangle);
  LoadOptions options;
  options.limits.max_triangles = 4;
  EXPECT_TRUE(fixture.Load(options).ok());
  options.limits.max_triangles = 3;
  const auto scene = fixture.Load(options);
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(scene.status().message()),
              HasSubstr("mesh 1 primitive 0: more triangles than the limit"));
}

TEST(Geometry, RefusesPositionsOutOfRangeOnEachSide) {
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      GltfFixture fixture;
      fixture.AddTriangles(kTriangle);
      fixture.AddNode({{"mesh", 0}});  // the places are relative to the first one
      std::array<double, 3> place = {};
      place[axis] = sign * 2e9;
      fixture.json["nodes"][1]["translation"] = place;
      EXPECT_THAT(ErrorOf(fixture), HasSubstr("geometry reaches beyond 1e9 metres")) << axis << sign;
      place[axis] = sign * 9e8;
      fixture.json["nodes"][1]["translation"] = place;
      EXPECT_TRUE(fixture.Load().ok()) << axis << sign;
    }
  }
}

}  // namespace
}  // namespace lumifold::scene
