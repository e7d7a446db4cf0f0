#include "worker/scene/deformers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/gltf_samples.h"
#include "tests/unit/scene/expect_near.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

TEST(Skins, InBindPoseIgnoreTheNodesTransform) {
  const Scene scene = At(0, SkinnedDocument());
  EXPECT_THAT(scene.meshes[0].positions,
              ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{1, 2, 0}, Vec3{0, 2, 0}));
  EXPECT_EQ(scene.instances[0].world_from_object.origin, (Vec3{0, 0, 0}));
}

TEST(Skins, MoveVerticesWithTheirJoints) {
  const Scene scene = At(1, SkinnedDocument());
  const Mesh& mesh = scene.meshes[0];
  ExpectNear(mesh.positions[1], {1, 0, 0});
  // (1, 2) is (1, 1) relative to the upper joint; rotated by 90 degrees (-1, 1); the joint is at (0, 1).
  ExpectNear(mesh.positions[2], {-1, 2, 0});
  ExpectNear(mesh.positions[3], {-1, 1, 0});
  ExpectNear(mesh.normals[2], {0, 0, 1});
}

TEST(Skins, BlendJointsByNormalisedWeights) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json.erase("animations");
  fixture.json["nodes"][1]["translation"] = {4, 1, 0};  // the upper joint moves 4 to the side
  const int weights = fixture.AddFloats({1, 0, 0, 0, 1, 0, 0, 0, 0.25f, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  const int more = fixture.AddFloats({0, 0, 0, 0, 0, 0, 0, 0, 0, 0.75f, 0, 0, 0, 0, 0, 0}, "VEC4");
  const int joints = fixture.AddBytes(std::vector<uint8_t>(16, 0), "VEC4", false);
  auto& attributes = fixture.json["meshes"][0]["primitives"][0]["attributes"];
  attributes["WEIGHTS_0"] = weights;
  attributes["JOINTS_1"] = joints;
  attributes["WEIGHTS_1"] = more;
  const Mesh mesh = At(0, fixture).meshes[0];
  ExpectNear(mesh.positions[2], {2, 2, 0});  // a quarter of the way, by the second set
  ExpectNear(mesh.positions[3], {4, 2, 0});
}

TEST(Skins, TakeAllJointsOfASparseVertex) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json.erase("animations");
  fixture.json["nodes"][1]["translation"] = {4, 1, 0};  // the upper joint moves 4 to the side
  const int joints = fixture.AddBytes(std::vector<uint8_t>(16, 0), "VEC4", false);
  fixture.json["accessors"][joints]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", fixture.AddView(std::string(1, 2))}, {"componentType", 5121}}},
      {"values", {{"bufferView", fixture.AddView(std::string("\0\1\0\0", 4))}}}};
  auto& attributes = fixture.json["meshes"][0]["primitives"][0]["attributes"];
  attributes["JOINTS_0"] = joints;
  attributes["WEIGHTS_0"] =
      fixture.AddFloats({1, 0, 0, 0, 1, 0, 0, 0, 0.25f, 0.75f, 0, 0, 1, 0, 0, 0}, "VEC4");
  const Mesh mesh = At(0, fixture).meshes[0];
  ExpectNear(mesh.positions[2], {4, 2, 0});  // three quarters of the way, by the second joint of four
  ExpectNear(mesh.positions[3], {0, 2, 0});
}

TEST(Skins, CountVerticesThatNoJointMoves) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] =
      fixture.AddFloats(std::vector<float>(16, 0.0f), "VEC4");
  EXPECT_THAT(
      At(0, fixture).warnings,
      Contains("vertices of skinned meshes that no joint moves: 4 (the first in mesh 0 primitive 0)"));
}

TEST(Skins, ShareAMeshAmongNodesOfOneSkin) {
  GltfFixture fixture = SkinnedDocument();
  fixture.AddNode({{"mesh", 0}, {"skin", 0}});
  fixture.AddNode({{"mesh", 0}});
  const Scene scene = At(1, fixture);
  EXPECT_EQ(scene.meshes.size(), 2u);  // deformed and not
  EXPECT_EQ(scene.instances.size(), 3u);
}

TEST(Skins, RefuseJointsThatDoNotExist) {
  GltfFixture influence = SkinnedDocument();
  influence.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] =
      influence.AddBytes(std::vector<uint8_t>(16, 2), "VEC4", false);
  EXPECT_EQ(ErrorOf(influence),
            "test.glb: mesh 0 primitive 0: JOINTS_0: joint 2 of vertex 0 does not exist (the skin has 2)");
  GltfFixture node = SkinnedDocument();
  node.json["skins"][0]["joints"] = {1, 77};
  EXPECT_EQ(ErrorOf(node), "test.glb: skin 0: joint node 77 does not exist (there are 3)");
  GltfFixture outside = SkinnedDocument();
  outside.Add("scenes", {{"nodes", {0}}});
  EXPECT_THAT(ErrorOf(outside), HasSubstr("skin 0: joint node 2 is not part of the scene"));
  GltfFixture skin = SkinnedDocument();
  skin.json["nodes"][0]["skin"] = 1;
  EXPECT_THAT(ErrorOf(skin), HasSubstr("node 0: skin 1 does not exist (there are 1)"));
}

TEST(Skins, RefuseMissingParts) {
  GltfFixture attributes = SkinnedDocument();
  attributes.json["meshes"][0]["primitives"][0]["attributes"].erase("JOINTS_0");
  EXPECT_THAT(ErrorOf(attributes), HasSubstr("is skinned, but has no JOINTS_0"));
  GltfFixture weights = SkinnedDocument();
  weights.json["meshes"][0]["primitives"][0]["attributes"].erase("WEIGHTS_0");
  EXPECT_THAT(ErrorOf(weights), HasSubstr("only one of JOINTS_0 and WEIGHTS_0"));
  GltfFixture matrices = SkinnedDocument();
  matrices.json["skins"][0]["inverseBindMatrices"] =
      matrices.AddFloats({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, "MAT4");
  EXPECT_THAT(ErrorOf(matrices), HasSubstr("skin 0: inverseBindMatrices: 1 matrices for 2 joints"));
  GltfFixture joints = SkinnedDocument();
  joints.json["skins"][0].erase("joints");
  EXPECT_THAT(ErrorOf(joints), HasSubstr("skin 0: no joints"));
}

TEST(Skins, WithoutInverseBindMatricesTakeIdentities) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json["skins"][0].erase("inverseBindMatrices");
  ExpectNear(At(0, fixture).meshes[0].positions[2], {1, 3, 0});
}

TEST(Skins, SurviveJointsThatFlattenSpace) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json["nodes"][1]["scale"] = {0, 0, 0};  // both upper vertices collapse to the joint
  const Scene scene = At(0, fixture);
  EXPECT_THAT(scene.warnings, Contains(StartsWith("triangles without area dropped: 1")));
  EXPECT_EQ(scene.meshes[0].triangles.size(), 3u);
}

TEST(Skins, RefuseVerticesOutOfRange) {
  GltfFixture fixture = SkinnedDocument();
  fixture.json["nodes"][1]["scale"] = {3e38, 3e38, 3e38};
  fixture.json["nodes"][2]["scale"] = {3e38, 1, 1};
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("is thrown out of floating-point range"));
}

TEST(MorphTargets, TakeTheNodesWeightsBeforeTheMeshs) {
  GltfFixture fixture = MorphedDocument();
  fixture.json.erase("animations");
  fixture.json["meshes"][0]["weights"] = {0.5, 0};
  fixture.AddNode({{"mesh", 0}, {"weights", {0, 1}}});
  const Scene scene = At(0, fixture);
  ASSERT_EQ(scene.meshes.size(), 2u);
  const auto positions_of = [&](int i) { return scene.meshes[scene.instances[i].mesh].positions; };
  EXPECT_THAT(positions_of(0), ElementsAre(Vec3{0, 0, 0}, Vec3{1.5f, 0, 0}, Vec3{0, 1, 0}));
  EXPECT_THAT(positions_of(1), ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 2, 0}));
}

TEST(MorphTargets, ShareAMeshAmongNodesOfEqualWeights) {
  GltfFixture fixture = MorphedDocument();
  fixture.json.erase("animations");
  for (int i = 0; i < 3; ++i) fixture.AddNode({{"mesh", 0}, {"weights", {0, i / 2}}});
  EXPECT_EQ(At(0, fixture).meshes.size(), 2u);
}

TEST(MorphTargets, DeformNormalsAndTangents) {
  GltfFixture fixture;
  const int normals = fixture.AddFloats({0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  const int tangents = fixture.AddFloats({1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, -1}, "VEC4");
  const int tilt = fixture.AddFloats({0, 1, 0, 0, 0, 0, 0, 0, 0}, "VEC3");
  fixture.AddTriangles(kTriangle, {{"attributes", {{"NORMAL", normals}, {"TANGENT", tangents}}},
                                   {"targets", {{{"NORMAL", tilt}, {"TANGENT", tilt}}}}});
  fixture.json["meshes"][0]["weights"] = {1};
  const Mesh mesh = At(0, fixture).meshes[0];
  ExpectNear(mesh.normals[0], {0, 0.70710678f, 0.70710678f});
  ExpectNear(mesh.normals[1], {0, 0, 1});
  EXPECT_NEAR(mesh.tangents[0].y, 0.70710678f, 1e-6);
  EXPECT_EQ(mesh.tangents[2].w, -1);
}

TEST(MorphTargets, RefuseWeightsAndLengthsThatDoNotFit) {
  GltfFixture weights = MorphedDocument();
  weights.json["nodes"][0]["weights"] = {1, 2, 3};
  weights.json.erase("animations");
  EXPECT_THAT(ErrorOf(weights), HasSubstr("mesh 0 primitive 0: 3 weights for 2 morph targets"));
  GltfFixture length = MorphedDocument();
  length.json.erase("animations");
  length.json["meshes"][0]["weights"] = {0, 1};
  length.json["meshes"][0]["primitives"][0]["targets"][1]["POSITION"] = length.AddFloats({1, 1, 1}, "VEC3");
  EXPECT_THAT(ErrorOf(length), HasSubstr("morph target 1: POSITION: 1 elements for 3 vertices"));
}

}  // namespace
}  // namespace lumifold::scene
