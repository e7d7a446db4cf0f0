#include "worker/scene/tangents.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/support/gltf_fixture.h"

namespace lumifold::scene {
namespace {

using testing::IsEmpty;

constexpr Vec3 kUp = {0, 0, 1};

/// A mesh in the plane z = 0 that faces +Z. Its texture coordinates are glTF's: v points down.
Mesh FlatMesh(const std::vector<Vec2>& points, const std::vector<Vec2>& uvs,
              const std::vector<uint32_t>& triangles) {
  Mesh mesh;
  for (const Vec2 p : points) mesh.positions.push_back({p.x, p.y, 0});
  mesh.normals.assign(points.size(), kUp);
  mesh.uvs[0] = uvs;
  mesh.triangles = triangles;
  return mesh;
}

Mesh Generated(Mesh mesh, const TextureRef& ref = {}) {
  GenerateTangents(ref, &mesh);
  EXPECT_EQ(mesh.tangents.size(), mesh.positions.size());
  return mesh;
}

void ExpectTangent(Vec4 actual, Vec3 direction, float handedness) {
  const Vec3 unit = Normalize(direction);
  EXPECT_NEAR(actual.x, unit.x, 1e-5);
  EXPECT_NEAR(actual.y, unit.y, 1e-5);
  EXPECT_NEAR(actual.z, unit.z, 1e-5);
  EXPECT_EQ(actual.w, handedness);
}

const std::vector<Vec2> kSquare = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
const std::vector<uint32_t> kSquareTriangles = {0, 1, 2, 0, 2, 3};

TEST(Tangents, PointWhereUGrowsAndAreRightHandedOnAnUprightPicture) {
  const Mesh mesh = Generated(FlatMesh(kSquare, {{0, 1}, {1, 1}, {1, 0}, {0, 0}}, kSquareTriangles));
  EXPECT_EQ(mesh.positions.size(), 4u);
  for (const Vec4& t : mesh.tangents) ExpectTangent(t, {1, 0, 0}, 1);
}

TEST(Tangents, AreLeftHandedOnAMirroredPicture) {
  const Mesh mesh = Generated(FlatMesh(kSquare, {{1, 1}, {0, 1}, {0, 0}, {1, 0}}, kSquareTriangles));
  for (const Vec4& t : mesh.tangents) ExpectTangent(t, {-1, 0, 0}, -1);
}

TEST(Tangents, SplitVerticesWhereTheMappingIsMirrored) {
  // A mapping folded at x = 1: u runs to the fold and back.
  const Mesh mesh = Generated(FlatMesh({{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}},
                                       {{0, 1}, {1, 1}, {0, 1}, {0, 0}, {1, 0}, {0, 0}},
                                       {0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4}));
  ASSERT_EQ(mesh.positions.size(), 8u);
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const uint32_t v = mesh.triangles[i];
    if (i < 6) {
      ExpectTangent(mesh.tangents[v], {1, 0, 0}, 1);
    } else {
      ExpectTangent(mesh.tangents[v], {-1, 0, 0}, -1);
    }
  }
  EXPECT_EQ(mesh.normals.size(), 8u);
  EXPECT_EQ(mesh.uvs[0].size(), 8u);
  EXPECT_EQ(mesh.positions[6].x, 1);
}

/// Two triangles around the origin, of 90 and 45 degrees there, whose tangents differ by 45 degrees.
Mesh BentFan() {
  return FlatMesh({{0, 0}, {1, 0}, {0, 1}, {-1, 1}}, {{0, 0}, {1, 0}, {0, -1}, {-1, 0}}, {0, 1, 2, 0, 2, 3});
}

TEST(Tangents, AreTheMeanOfTheirTrianglesWeightedByAngle) {
  const Mesh mesh = Generated(BentFan());
  const float half = std::sqrt(0.5f);
  ASSERT_EQ(mesh.positions.size(), 4u);
  ExpectTangent(mesh.tangents[0], {2 + half, -half, 0}, 1);  // 90 degrees of (1, 0), 45 of (h, -h)
  ExpectTangent(mesh.tangents[1], {1, 0, 0}, 1);
  ExpectTangent(mesh.tangents[3], {1, -1, 0}, 1);
}

TEST(Tangents, DoNotDependOnHowVerticesAreShared) {
  const Mesh shared = Generated(BentFan());
  Mesh apart = BentFan();
  apart.positions = {apart.positions[0], apart.positions[1], apart.positions[2],
                     apart.positions[0], apart.positions[2], apart.positions[3]};
  apart.uvs[0] = {apart.uvs[0][0], apart.uvs[0][1], apart.uvs[0][2],
                  apart.uvs[0][0], apart.uvs[0][2], apart.uvs[0][3]};
  apart.normals.assign(6, kUp);
  apart.triangles = {0, 1, 2, 3, 4, 5};
  apart = Generated(apart);
  for (size_t i = 0; i < 6; ++i) {
    const Vec4 a = shared.tangents[shared.triangles[i]], b = apart.tangents[apart.triangles[i]];
    EXPECT_EQ(a.x, b.x);
    EXPECT_EQ(a.y, b.y);
  }
}

TEST(Tangents, StayApartWhereTrianglesShareAVertexOnly) {
  // Two triangles that share the origin; the texture of the second is rotated by 90 degrees.
  const Mesh mesh = Generated(FlatMesh({{0, 0}, {1, 0}, {0, 1}, {-1, 0}, {0, -1}},
                                       {{0, 0}, {1, 0}, {0, -1}, {0, -1}, {1, 0}}, {0, 1, 2, 0, 3, 4}));
  ASSERT_EQ(mesh.positions.size(), 6u);
  ExpectTangent(mesh.tangents[mesh.triangles[0]], {1, 0, 0}, 1);
  ExpectTangent(mesh.tangents[mesh.triangles[3]], {0, -1, 0}, -1);
}

TEST(Tangents, AtAnEdgeOfMoreThanTwoTrianglesGoInPairsInTheirOrder) {
  // Triangles on both sides of the edge from vertex 0 to 1, the texture sheared differently on each: u grows
  // along (1, `slope`). Those of the left traverse it forwards, those of the right backwards.
  const auto mesh_of = [](std::vector<uint32_t> triangles) {
    return Generated(FlatMesh({{0, 0}, {0, 1}, {-1, 0}, {1, 0}, {1, 1}, {-1, 1}},
                              {{0, 0}, {0, -1}, {-1, -0.5f}, {1, 0}, {1, 0}, {-1, -3}},
                              std::move(triangles)));
  };
  const auto sum = [](float slope, float other) {
    return Normalize(Vec3{1, slope, 0}) + Normalize(Vec3{1, other, 0});
  };
  const auto expect = [](const Mesh& mesh, size_t triangle, Vec3 direction) {
    const size_t of_right = triangle == 1 || triangle == 2 ? 1 : 0;  // its corner at vertex 0
    ExpectTangent(mesh.tangents[mesh.triangles[3 * triangle + of_right]], direction, 1);
    ExpectTangent(mesh.tangents[mesh.triangles[3 * triangle + 1 - of_right]], direction, 1);
  };
  // Slopes 0.5 (left), 0 (right), 1 (right), 2 (left): the first of each side, then the second.
  const Mesh four = mesh_of({0, 1, 2, 1, 0, 3, 1, 0, 4, 0, 1, 5});
  for (const size_t triangle : {0u, 1u}) expect(four, triangle, sum(0.5f, 0));
  for (const size_t triangle : {2u, 3u}) expect(four, triangle, sum(1, 2));
  const Mesh three = mesh_of({0, 1, 2, 1, 0, 3, 1, 0, 4});
  for (const size_t triangle : {0u, 1u}) expect(three, triangle, sum(0.5f, 0));
  expect(three, 2, {1, 1, 0});  // no partner is left for it
}

TEST(Tangents, ArePerpendicularToTheNormal) {
  Mesh mesh = FlatMesh(kSquare, {{0, 1}, {1, 1}, {1, 0}, {0, 0}}, kSquareTriangles);
  for (Vec3& n : mesh.normals) n = Normalize({0.6f, 0, 0.8f});
  for (const Vec4& t : Generated(mesh).tangents) ExpectTangent(t, {0.8f, 0, -0.6f}, 1);
}

TEST(Tangents, OfAFlatMeshBelongToTheFace) {
  Mesh mesh = FlatMesh(kSquare, {{0, 1}, {1, 1}, {1, 0}, {0, 0}}, kSquareTriangles);
  mesh.normals.clear();
  mesh.positions[3].z = 1;
  const Mesh split = Generated(mesh);
  EXPECT_EQ(split.positions.size(), 6u);
  EXPECT_THAT(split.normals, IsEmpty());
  for (size_t i = 0; i < 6; i += 3) {
    const Vec3 a = split.positions[split.triangles[i]];
    const Vec3 normal =
        Cross(split.positions[split.triangles[i + 1]] - a, split.positions[split.triangles[i + 2]] - a);
    for (size_t c = 0; c < 3; ++c) {
      const Vec4 t = split.tangents[split.triangles[i + c]];
      EXPECT_NEAR(Dot({t.x, t.y, t.z}, normal), 0, 1e-6);
    }
  }
}

TEST(Tangents, WithoutAMappingAreAnyPerpendicularVector) {
  const Mesh mesh = Generated(FlatMesh(kSquare, {{0, 0}, {0, 0}, {0, 0}, {0, 0}}, kSquareTriangles));
  for (const Vec4& t : mesh.tangents) {
    EXPECT_NEAR(Length({t.x, t.y, t.z}), 1, 1e-6);
    EXPECT_EQ(t.z, 0);
  }
}

TEST(Tangents, OfATriangleWithoutMappingComeFromItsNeighbours) {
  // Vertex 3 has the texture coordinate of vertex 0: the second triangle has a degenerate mapping.
  const Mesh mesh = Generated(FlatMesh(kSquare, {{0, 1}, {1, 1}, {1, 0}, {0, 1}}, kSquareTriangles));
  EXPECT_EQ(mesh.positions.size(), 4u);
  ExpectTangent(mesh.tangents[0], {1, 0, 0}, 1);
  ExpectTangent(mesh.tangents[2], {1, 0, 0}, 1);
}

TEST(Tangents, FollowTheTextureTransform) {
  TextureRef quarter;  // u' = v, v' = -u: the picture's right is the direction of v
  quarter.row_u = {0, 1};
  quarter.row_v = {-1, 0};
  const Mesh mesh = Generated(FlatMesh(kSquare, {{0, 1}, {1, 1}, {1, 0}, {0, 0}}, kSquareTriangles), quarter);
  for (const Vec4& t : mesh.tangents) ExpectTangent(t, {0, -1, 0}, 1);
}

TEST(Tangents, UseTheCoordinatesOfTheirTexture) {
  const std::vector<Vec2> upright = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
  const std::vector<Vec2> mirrored = {{1, 1}, {0, 1}, {0, 0}, {1, 0}};
  for (const int set : {0, 1}) {
    Mesh both = FlatMesh(kSquare, mirrored, kSquareTriangles);
    both.uvs[1] = mirrored;
    both.uvs[set] = upright;
    TextureRef ref;
    ref.uv_set = set;
    for (const Vec4& t : Generated(both, ref).tangents) ExpectTangent(t, {1, 0, 0}, 1);
  }
}

/// A textured square; `attributes` are added to its primitive, `material` to its material.
GltfFixture TexturedSquare(const nlohmann::json& material) {
  GltfFixture fixture;
  fixture.Add("images", {{"bufferView", fixture.AddView(EncodePng(1, 1, 3, 8, false, {128, 128, 255}))}});
  fixture.Add("textures", {{"source", 0}});
  fixture.Add("materials", material);
  const int uvs = fixture.AddFloats({0, 1, 1, 1, 0, 0}, "VEC2");
  const int normals = fixture.AddFloats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  fixture.AddTriangles(kTriangle,
                       {{"material", 0}, {"attributes", {{"TEXCOORD_0", uvs}, {"NORMAL", normals}}}});
  return fixture;
}

TEST(Tangents, AreGeneratedIfANormalTextureNeedsThem) {
  const auto scene = TexturedSquare({{"normalTexture", {{"index", 0}}}}).Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->meshes[0].tangents.size(), 3u);
  ExpectTangent(scene->meshes[0].tangents[0], {1, 0, 0}, 1);
}

TEST(Tangents, AreNotGeneratedIfNothingNeedsThem) {
  const auto plain = TexturedSquare({{"occlusionTexture", {{"index", 0}}}}).Load();
  ASSERT_TRUE(plain.ok()) << plain.status();
  EXPECT_THAT(plain->meshes[0].tangents, IsEmpty());
  const auto other_set = TexturedSquare({{"normalTexture", {{"index", 0}, {"texCoord", 1}}}}).Load();
  ASSERT_TRUE(other_set.ok()) << other_set.status();
  EXPECT_THAT(other_set->meshes[0].tangents, IsEmpty());
}

TEST(Tangents, OfTheFileAreUnchanged) {
  GltfFixture fixture = TexturedSquare({{"normalTexture", {{"index", 0}}}});
  fixture.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] =
      fixture.AddFloats({0, 1, 0, -1, 0, 1, 0, -1, 0, 1, 0, -1}, "VEC4");
  const auto scene = fixture.Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  for (const Vec4& t : scene->meshes[0].tangents) ExpectTangent(t, {0, 1, 0}, -1);
}

}  // namespace
}  // namespace lumifold::scene
