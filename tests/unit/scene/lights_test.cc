#include "worker/scene/lights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/gltf_samples.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

nlohmann::json& LightsOf(GltfFixture* fixture) {
  return fixture->json["extensions"]["KHR_lights_punctual"]["lights"];
}

TEST(Lights, AreReadWithTheirUnitsAsWritten) {
  const Scene scene = MustLoad(LitDocument());
  ASSERT_EQ(scene.lights.size(), 3u);
  EXPECT_THAT(scene.warnings, Contains("no camera: one that sees everything is used"));
  const PunctualLight& point = scene.lights[0];
  EXPECT_EQ(point.kind, PunctualLight::Kind::kPoint);
  EXPECT_EQ(point.color, (Vec3{1, 0.5f, 0.25f}));
  EXPECT_EQ(point.intensity, 40);
  EXPECT_EQ(point.range, 12);
  const PunctualLight& spot = scene.lights[1];
  EXPECT_EQ(spot.kind, PunctualLight::Kind::kSpot);
  EXPECT_EQ(spot.name, "lamp");
  EXPECT_EQ(spot.inner_cone_angle, 0.2f);
  EXPECT_EQ(spot.outer_cone_angle, 0.5f);
  EXPECT_EQ(spot.intensity, 1);
  EXPECT_EQ(spot.range, 0);
  EXPECT_EQ(scene.lights[2].kind, PunctualLight::Kind::kDirectional);
  EXPECT_EQ(scene.lights[2].intensity, 3);
}

TEST(Lights, HaveTheirNodesPlaceWithoutItsScale) {
  GltfFixture fixture = LitDocument();
  const float half = 0.70710678f;
  fixture.json["nodes"][2]["rotation"] = {-half, 0, 0, half};  // -Z turns to -Y
  fixture.json["nodes"][2]["name"] = "Ceiling";
  const PunctualLight light = MustLoad(fixture).lights[1];
  EXPECT_EQ(light.name, "Ceiling");
  EXPECT_EQ(light.world_from_light.origin, (Vec3{0, 1, 0}));
  EXPECT_NEAR(light.world_from_light.z.y, 1, 1e-6);
  EXPECT_NEAR(light.world_from_light.Determinant(), 1, 1e-6);
}

TEST(Lights, KeepAnInnerConeWithinTheOuterOne) {
  GltfFixture fixture = LitDocument();
  LightsOf(&fixture)[1]["spot"] = {{"innerConeAngle", 0.5}, {"outerConeAngle", 0.5}};
  const PunctualLight light = MustLoad(fixture).lights[1];
  EXPECT_LT(light.inner_cone_angle, light.outer_cone_angle);
  EXPECT_NEAR(light.inner_cone_angle, 0.5, 1e-3);
}

TEST(Lights, WithASingularTransformAreLeftOut) {
  GltfFixture fixture = LitDocument();
  fixture.json["nodes"][1]["scale"] = {0, 0, 0};
  const Scene scene = MustLoad(fixture);
  EXPECT_EQ(scene.lights.size(), 2u);
  EXPECT_THAT(scene.warnings, Contains(StartsWith("lights flattened by their transform left out: 1")));
}

TEST(Lights, ClampImpossibleValuesAndCountIt) {
  GltfFixture fixture = LitDocument();
  LightsOf(&fixture)[0]["intensity"] = -3;
  const Scene scene = MustLoad(fixture);
  EXPECT_EQ(scene.lights[0].intensity, 0);
  EXPECT_THAT(scene.warnings, Contains(HasSubstr("values of intensity outside")));
}

TEST(Lights, ThatNoNodeUsesAreLeftOut) {
  GltfFixture fixture = LitDocument();
  for (auto& node : fixture.json["nodes"]) node.erase("extensions");
  EXPECT_THAT(MustLoad(fixture).lights, IsEmpty());
}

TEST(Lights, RefuseMalformedValues) {
  GltfFixture index = LitDocument();
  index.json["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = 3;
  EXPECT_EQ(ErrorOf(index), "test.glb: node 1: light 3 does not exist (there are 3)");
  GltfFixture type = LitDocument();
  LightsOf(&type)[1]["type"] = "neon";
  EXPECT_EQ(ErrorOf(type), "test.glb: node 2: light 1 \"lamp\": type \"neon\" is not KHR_lights_punctual's");
  GltfFixture color = LitDocument();
  LightsOf(&color)[0]["color"] = {1, 2};
  EXPECT_THAT(ErrorOf(color), HasSubstr("light 0: color is not an array of 3 numbers"));
}

}  // namespace
}  // namespace lumifold::scene
