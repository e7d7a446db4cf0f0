#include "worker/scene/animations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/support/gltf_samples.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

/// One triangle; its node's property `path` is animated with these keyframes.
GltfFixture Animated(const char* path, const char* interpolation, const std::vector<float>& times,
                     const std::vector<float>& values, const char* type = "VEC3") {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.Add("animations", {{"name", "move"},
                             {"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", path}}}}}},
                             {"samplers",
                              {{{"input", fixture.AddFloats(times, "SCALAR")},
                                {"output", fixture.AddFloats(values, type)},
                                {"interpolation", interpolation}}}}});
  return fixture;
}

Vec3 OriginAt(double time_seconds, const GltfFixture& fixture) {
  const Scene scene = At(time_seconds, fixture);
  return scene.instances.empty() ? Vec3{} : scene.instances[0].world_from_object.origin;
}

TEST(Animations, MoveNodesLinearly) {
  const GltfFixture fixture = Animated("translation", "LINEAR", {1, 3}, {0, 0, 0, 4, 0, 8});
  EXPECT_EQ(OriginAt(0, fixture), (Vec3{0, 0, 0}));
  EXPECT_EQ(OriginAt(1.5, fixture), (Vec3{1, 0, 2}));
  EXPECT_EQ(OriginAt(2, fixture), (Vec3{2, 0, 4}));
  EXPECT_EQ(OriginAt(99, fixture), (Vec3{4, 0, 8}));
}

/// Two clips of the node, one to each side, and a third of its scale.
GltfFixture ThreeClips() {
  GltfFixture fixture = Animated("translation", "LINEAR", {0, 1}, {0, 0, 0, -1, 0, 0});
  nlohmann::json& clips = fixture.json["animations"];
  clips[0]["name"] = "left";
  clips.push_back(clips[0]);
  clips[1]["name"] = "right";
  clips[1]["samplers"][0]["output"] = fixture.AddFloats({0, 0, 0, 1, 0, 0}, "VEC3");
  clips.push_back(clips[0]);
  clips[2]["name"] = "grow";
  clips[2]["channels"][0]["target"]["path"] = "scale";
  clips[2]["samplers"][0]["output"] = fixture.AddFloats({1, 1, 1, 2, 2, 2}, "VEC3");
  return fixture;
}

TEST(Animations, OfOnePropertyAreAlternativesOfWhichTheFirstPlays) {
  const GltfFixture fixture = ThreeClips();
  EXPECT_EQ(OriginAt(1, fixture), (Vec3{-1, 0, 0}));
  EXPECT_EQ(At(1, fixture).instances[0].world_from_object.x, (Vec3{2, 0, 0})) << "the third fits";
  EXPECT_THAT(
      MustLoad(fixture).warnings,
      Contains(HasSubstr("do not play (--animation chooses one): 1 (the first in animation 1 \"right\")")));
}

TEST(Animations, PlayAloneWhereOneIsChosen) {
  const GltfFixture fixture = ThreeClips();
  LoadOptions options;
  options.time_seconds = 1;
  for (const char* wanted : {"right", "1"}) {
    options.animation = wanted;
    const auto scene = fixture.Load(options);
    ASSERT_TRUE(scene.ok()) << scene.status();
    EXPECT_EQ(scene->instances[0].world_from_object.origin, (Vec3{1, 0, 0}));
    EXPECT_EQ(scene->instances[0].world_from_object.x, (Vec3{1, 0, 0})) << "nothing else plays";
    EXPECT_THAT(scene->warnings, testing::Not(Contains(HasSubstr("do not play"))));
  }
  options.animation = "jump";
  EXPECT_EQ(fixture.Load(options).status(),
            absl::NotFoundError("test.glb: the scene has no animation called 'jump'; there are: 0 'left', "
                                "1 'right', 2 'grow'"));
}

TEST(Animations, StepFromKeyframeToKeyframe) {
  const GltfFixture fixture = Animated("translation", "STEP", {1, 3}, {5, 0, 0, 6, 0, 0});
  EXPECT_EQ(OriginAt(2.99, fixture), (Vec3{5, 0, 0}));
  EXPECT_EQ(OriginAt(3, fixture), (Vec3{6, 0, 0}));
}

TEST(Animations, FollowCubicSplines) {
  // In-tangent, value, out-tangent of each keyframe: from 0 to 1 in two seconds, flat at both ends.
  const GltfFixture fixture =
      Animated("translation", "CUBICSPLINE", {0, 2}, {9, 9, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 9, 9, 9});
  EXPECT_EQ(OriginAt(0, fixture), (Vec3{0, 0, 0}));
  EXPECT_EQ(OriginAt(1, fixture), (Vec3{0.5f, 0, 0}));
  EXPECT_EQ(OriginAt(0.5, fixture), (Vec3{0.15625f, 0, 0}));
  EXPECT_EQ(OriginAt(2, fixture), (Vec3{1, 0, 0}));
}

TEST(Animations, TurnAndScaleNodes) {
  const float half = 0.70710678f;
  const Scene turned =
      At(0.5, Animated("rotation", "LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0, 1, 0}, "VEC4"));  // half a turn
  EXPECT_NEAR(turned.instances[0].world_from_object.x.y, 1, 1e-6);
  const Scene quarter = At(0, Animated("rotation", "STEP", {0}, {0, 0, 2 * half, 2 * half}, "VEC4"));
  EXPECT_NEAR(quarter.instances[0].world_from_object.x.y, 1, 1e-6);
  const Scene scaled = At(0.5, Animated("scale", "LINEAR", {0, 1}, {1, 1, 1, 3, 1, 1}));
  EXPECT_EQ(scaled.instances[0].world_from_object.x.x, 2);
}

TEST(Animations, TurnAboutAnyAxis) {
  const Vec3 axis = {0.6f, 0.48f, 0.64f};
  const auto turn = [&](float angle) {
    const float s = std::sin(0.5f * angle);
    return std::vector<float>{s * axis.x, s * axis.y, s * axis.z, std::cos(0.5f * angle)};
  };
  std::vector<float> values = turn(0.4f);
  const std::vector<float> end = turn(1.6f);
  values.insert(values.end(), end.begin(), end.end());
  const auto turned =
      At(0.25, Animated("rotation", "LINEAR", {0, 1}, values, "VEC4")).instances[0].world_from_object;
  // Rodrigues' formula for 0.4 + (1.6 - 0.4) / 4.
  const float c = std::cos(0.7f), s = std::sin(0.7f);
  const auto rotated = [&](Vec3 v) { return v * c + Cross(axis, v) * s + axis * (Dot(axis, v) * (1 - c)); };
  for (const auto& [column, expected] : {std::pair{turned.x, rotated({1, 0, 0})},
                                         {turned.y, rotated({0, 1, 0})},
                                         {turned.z, rotated({0, 0, 1})}}) {
    EXPECT_NEAR(column.x, expected.x, 1e-6);
    EXPECT_NEAR(column.y, expected.y, 1e-6);
    EXPECT_NEAR(column.z, expected.z, 1e-6);
  }
}

TEST(Animations, PlayTogether) {
  GltfFixture fixture = Animated("translation", "STEP", {0}, {1, 2, 3});
  const GltfFixture other = Animated("scale", "STEP", {0}, {4, 4, 4});
  nlohmann::json second = other.json["animations"][0];
  second["samplers"][0]["input"] = fixture.AddFloats({0}, "SCALAR");
  second["samplers"][0]["output"] = fixture.AddFloats({4, 4, 4}, "VEC3");
  fixture.Add("animations", second);
  const Scene scene = At(0, fixture);
  EXPECT_EQ(scene.instances[0].world_from_object.origin, (Vec3{1, 2, 3}));
  EXPECT_EQ(scene.instances[0].world_from_object.x.x, 4);
}

TEST(Animations, MoveChildrenAndCameras) {
  GltfFixture fixture = Animated("translation", "STEP", {0}, {1, 2, 3});
  fixture.Add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", 0.5}, {"znear", 0.1}}}});
  fixture.json["nodes"][0]["children"] = {fixture.AddNode({{"camera", 0}, {"translation", {1, 0, 0}}})};
  EXPECT_EQ(At(0, fixture).cameras[0].world_from_camera.origin, (Vec3{2, 2, 3}));
}

TEST(Animations, ReportWhetherAnythingMovesAndForHowLong) {
  EXPECT_FALSE(At(0, FurnishedDocument()).animated);
  EXPECT_FALSE(At(0, Animated("translation", "STEP", {0.5f}, {1, 2, 3})).animated);
  const Scene scene = At(0, Animated("translation", "LINEAR", {1, 3.5f}, {0, 0, 0, 4, 0, 8}));
  EXPECT_TRUE(scene.animated);
  EXPECT_EQ(scene.animation_duration, 3.5);
}

TEST(Animations, LeaveOutUnsupportedTargets) {
  GltfFixture pointer = Animated("translation", "STEP", {0}, {1, 2, 3});
  pointer.json["animations"][0]["channels"][0]["target"] = {{"path", "pointer"}};
  EXPECT_THAT(At(0, pointer).warnings,
              Contains(StartsWith("animations of other things than nodes and morph weights left out: 1")));
  GltfFixture matrix = Animated("translation", "STEP", {0}, {1, 2, 3});
  matrix.json["nodes"][0]["matrix"] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1};
  EXPECT_EQ(OriginAt(0, matrix), (Vec3{5, 0, 0}));
  EXPECT_THAT(At(0, matrix).warnings, Contains(StartsWith("animations of nodes that have a matrix")));
  GltfFixture nobody = Animated("translation", "STEP", {0}, {1, 2, 3});
  nobody.json["animations"][0]["channels"][0]["target"].erase("node");
  EXPECT_EQ(OriginAt(0, nobody), (Vec3{0, 0, 0}));
  const Scene weights = At(0, Animated("weights", "STEP", {0}, {1}, "SCALAR"));
  EXPECT_THAT(weights.warnings, Contains(StartsWith("animations of morph weights without morph targets")));
}

TEST(Animations, RefuseTimesThatDecrease) {
  EXPECT_EQ(ErrorOf(Animated("translation", "LINEAR", {0, 2, 1}, {0, 0, 0, 0, 0, 0, 0, 0, 0})),
            "test.glb: animation 0 \"move\" channel 0: accessor 1: keyframe times decrease");
}

TEST(Animations, RefuseTooFewValues) {
  EXPECT_THAT(ErrorOf(Animated("translation", "LINEAR", {0, 2}, {0, 0, 0})),
              HasSubstr("channel 0: accessor 2: 1 elements for 2 keyframes of 1"));
  EXPECT_THAT(ErrorOf(Animated("translation", "CUBICSPLINE", {0, 2}, {0, 0, 0, 0, 0, 0})),
              HasSubstr("2 elements for 2 keyframes of 3"));
  EXPECT_THAT(ErrorOf(Animated("rotation", "LINEAR", {0}, {0, 0, 0})),
              HasSubstr("does not hold elements of 4 components"));
  EXPECT_THAT(ErrorOf(Animated("translation", "LINEAR", {}, {})), HasSubstr("no keyframes"));
}

TEST(Animations, RefuseIndicesOfMissingObjects) {
  const GltfFixture good = Animated("translation", "LINEAR", {0}, {0, 0, 0});
  const auto with = [&](const char* pointer, const nlohmann::json& value) {
    GltfFixture fixture = good;
    fixture.json[nlohmann::json::json_pointer(std::string("/animations/0") + pointer)] = value;
    return ErrorOf(fixture);
  };
  EXPECT_THAT(with("/channels/0/target/node", 9), HasSubstr("channel 0: node 9 does not exist"));
  EXPECT_THAT(with("/channels/0/sampler", 9), HasSubstr("channel 0: sampler 9 does not exist"));
  EXPECT_THAT(with("/samplers/0/input", 9), HasSubstr("accessor 9: does not exist"));
  EXPECT_THAT(with("/samplers/0/output", -1), HasSubstr("accessor -1: does not exist"));
  EXPECT_THAT(with("/samplers/0/interpolation", "WILD"), HasSubstr("interpolation \"WILD\" is not glTF's"));
  EXPECT_THAT(with("/channels", "nonsense"), HasSubstr("animation 0 \"move\": no channels"));
  EXPECT_THAT(with("/channels/0/target", 3), HasSubstr("channel 0: no target"));
}

TEST(Animations, MorphMeshes) {
  const auto positions = [](double time) { return At(time, MorphedDocument()).meshes[0].positions; };
  EXPECT_THAT(positions(0), ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}));
  EXPECT_THAT(positions(1), ElementsAre(Vec3{0, 0, 0}, Vec3{1.5f, 0, 0}, Vec3{0, 1.25f, 0}));
  EXPECT_THAT(positions(2), ElementsAre(Vec3{0, 0, 0}, Vec3{2, 0, 0}, Vec3{0, 1.5f, 0}));
}

/// `fixture` with the target of its animation replaced by a pointer.
GltfFixture Pointed(GltfFixture fixture, const std::string& pointer) {
  fixture.json["extensionsUsed"] = fixture.json["extensionsRequired"] = {"KHR_animation_pointer"};
  fixture.json["animations"][0]["channels"][0]["target"] = {
      {"path", "pointer"}, {"extensions", {{"KHR_animation_pointer", {{"pointer", pointer}}}}}};
  return fixture;
}

GltfFixture PointedScalar(const std::string& pointer, const std::vector<float>& values) {
  return Pointed(Animated("translation", "LINEAR", {0, 2}, values, "SCALAR"), pointer);
}

TEST(PointedAnimations, SetCameras) {
  GltfFixture fixture = PointedScalar("/cameras/0/perspective/yfov", {0.5f, 1.5f});
  fixture.Add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 0.1}}}});
  fixture.AddNode({{"camera", 0}});
  EXPECT_FLOAT_EQ(At(0, fixture).cameras[0].yfov, 0.5f);
  EXPECT_FLOAT_EQ(At(1, fixture).cameras[0].yfov, 1);
  EXPECT_TRUE(At(1, fixture).animated);
  EXPECT_THAT(At(1, fixture).warnings, testing::Not(Contains(HasSubstr("pointer"))));
}

TEST(PointedAnimations, SetLights) {
  GltfFixture fixture = Pointed(Animated("translation", "STEP", {0, 2}, {1, 0, 0, 0, 1, 0}),
                                "/extensions/KHR_lights_punctual/lights/0/color");
  fixture.json["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
  fixture.AddNode({{"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
  EXPECT_EQ(At(1, fixture).lights[0].color, (Vec3{1, 0, 0}));
  EXPECT_EQ(At(3, fixture).lights[0].color, (Vec3{0, 1, 0}));
}

TEST(PointedAnimations, SetMaterialsAndTheirExtensions) {
  for (const auto& [pointer, value] :
       {std::pair<const char*, float Material::*>("alphaCutoff", &Material::alpha_cutoff),
        {"extensions/KHR_materials_ior/ior", &Material::ior}}) {
    GltfFixture fixture = PointedScalar(absl::StrCat("/materials/0/", pointer), {1, 2});
    fixture.Add("materials", {{"alphaMode", "MASK"}});
    fixture.json["meshes"][0]["primitives"][0]["material"] = 0;
    EXPECT_FLOAT_EQ(At(1, fixture).materials[0].*value, 1.5f) << pointer;
  }
  GltfFixture fixture =
      Pointed(Animated("translation", "LINEAR", {0, 2}, {0, 0, 0, 1, 1, 0.5f, 0, 0}, "VEC4"),
              "/materials/0/pbrMetallicRoughness/baseColorFactor");
  fixture.Add("materials", nlohmann::json::object());
  EXPECT_EQ(At(1, fixture).materials[0].base.color, (Vec3{0.5f, 0.25f, 0}));
}

TEST(PointedAnimations, MoveAndHideNodes) {
  const GltfFixture moved =
      Pointed(Animated("translation", "LINEAR", {0, 2}, {0, 0, 0, 4, 0, 0}), "/nodes/0/translation");
  EXPECT_EQ(OriginAt(1, moved), (Vec3{2, 0, 0}));
  GltfFixture hidden = PointedScalar("/nodes/0/extensions/KHR_node_visibility/visible", {1, 0});
  hidden.json["animations"][0]["samplers"][0]["interpolation"] = "STEP";
  hidden.json["animations"][0]["samplers"][0]["output"] = hidden.AddBytes({1, 0}, "SCALAR", false);
  hidden.json["nodes"][0]["translation"] = {7, 0, 0};
  EXPECT_EQ(OriginAt(1, hidden), (Vec3{7, 0, 0}));
  EXPECT_EQ(At(2, hidden).instances.size(), 0u);
}

TEST(PointedAnimations, NameWhatStandsStill) {
  for (const char* pointer : {"/materials/0/extensions/KHR_new/value", "/materials/x/alphaCutoff", "",
                              "alphaCutoff", "/nodes/0/weights/1", "/materials/0/alphaCutoff/1", "/~"}) {
    const Scene scene = At(1, PointedScalar(pointer, {1, 2}));
    EXPECT_THAT(scene.warnings, Contains(HasSubstr("left out"))) << pointer;
    EXPECT_FALSE(scene.animated);
  }
  EXPECT_THAT(At(1, PointedScalar("/materials/12/extensions/KHR_new/value", {1, 2})).warnings,
              Contains(HasSubstr("animations of /materials/#/extensions/KHR_new/value left out")));
}

TEST(PointedAnimations, RefuseWhatDoesNotExist) {
  for (const char* pointer : {"/materials/9/alphaCutoff", "/cameras/0/perspective/yfov",
                              "/extensions/KHR_lights_punctual/lights/0/range", "/nodes/7/scale",
                              "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/"
                              "KHR_texture_transform/rotation"}) {
    GltfFixture fixture = PointedScalar(pointer, {1, 2});
    fixture.Add("materials", nlohmann::json::object());
    EXPECT_FALSE(LoadGltf(fixture.Glb(), "f.glb", nullptr).ok()) << pointer;
  }
}

}  // namespace
}  // namespace lumifold::scene
