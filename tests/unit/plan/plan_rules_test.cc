#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>

#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/plan/plan_scenes.h"
#include "worker/plan/plan_rules.h"
#include "worker/plan/probe.h"
#include "worker/plan/scene_facts.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::plan {
namespace {

using scene::Material;
using scene::Scene;
using ::testing::HasSubstr;

Material Gray() { return lumifold::testing::Lambert({0.5f, 0.5f, 0.5f}); }

Material Glossy() {
  Material glossy = Gray();
  glossy.name = "varnish";
  glossy.specular.factor = 1;
  glossy.base.roughness = 0.4f;
  return glossy;
}

scene::PunctualLight Bulb() {
  scene::PunctualLight bulb;
  bulb.world_from_light.origin = {0, 1, 1};
  return bulb;
}

/// The values of these decisions.
std::vector<std::string> Values(const Plan& plan, const std::vector<std::string>& names) {
  std::vector<std::string> values;
  values.reserve(names.size());
  for (const std::string& name : names) values.push_back(ValueOf(plan, name));
  return values;
}

Scene Generated(const std::string& name) {
  const auto glb = scenes::EncodeGlb(scenes::FindScene(name)->build());
  EXPECT_TRUE(glb.ok()) << glb.status();
  return scene::LoadGltf(*glb, name, nullptr).value();
}

const std::vector<std::string> kLayers = {"direct", "indirect", "albedo", "emission", "glossy"};
using Strings = std::vector<std::string>;

TEST(PlanRules, ADiffuseRoomNeedsNoGlossyLayersAndNoLevels) {
  const Plan plan = PlanOf(LitBox(Gray()));
  EXPECT_EQ(Values(plan, kLayers), (Strings{"on", "on", "on", "on", "off"}));
  EXPECT_EQ(Values(plan, {"levels", "bounces", "general-code", "emission-on-hits"}),
            (Strings{"0", "8", "off", "on"}));
  EXPECT_EQ(plan.tracing.levels, 0);
  EXPECT_EQ(plan.max_bounces, 8);
  EXPECT_TRUE(plan.tracing.diffuse_code);
  EXPECT_FALSE(plan.tracing.layers.glossy);
  EXPECT_EQ(Find(plan, "levels").reason, "no material is a perfect mirror or smooth glass");
}

TEST(PlanRules, AGlossyMaterialNeedsItsLayersAndIsNamed) {
  const Plan plan = PlanOf(LitBox(Glossy()));
  EXPECT_EQ(Values(plan, {"glossy", "general-code", "levels"}), (Strings{"on", "on", "0"}));
  EXPECT_THAT(Find(plan, "glossy").reason, HasSubstr("'varnish'"));
}

TEST(PlanRules, MirrorsThatFaceEachOtherNeedAllLevels) {
  const Plan plan = PlanOf(LitBox(Mirror()));
  EXPECT_EQ(Values(plan, {"direct", "albedo", "glossy", "levels", "general-code"}),
            (Strings{"off", "off", "off", "3", "on"}));
  EXPECT_THAT(Find(plan, "levels").reason, HasSubstr("'mirror'"));
}

TEST(PlanRules, OneFlatMirrorNeedsOneLevel) {
  Scene room = LitBox(Gray());
  room.materials.push_back(Mirror());
  lumifold::testing::Place(&room, lumifold::testing::QuadMesh({-1, -1, -1.9f}, {2, 0, 0}, {0, 2, 0}, 2));
  const Plan plan = PlanOf(room);
  EXPECT_EQ(ValueOf(plan, "levels"), "1");
  EXPECT_EQ(plan.tracing.levels, 1);
}

TEST(PlanRules, AnEmitterBehindGlassIsSeenThroughALevel) {
  Scene room = LitBox(Gray());
  room.materials.push_back(ClearPane());
  lumifold::testing::Place(&room, lumifold::testing::QuadMesh({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, 2));
  const Plan plan = PlanOf(room);
  EXPECT_EQ(Values(plan, {"levels", "emission", "general-code", "emission-on-hits"}),
            (Strings{"1", "on", "on", "on"}));
}

TEST(PlanRules, DeeperLevelsThanTheProbeSeesAreLeftOut) {
  // Two mirror balls far apart, before a background without light: each is a speck in the other.
  Scene scene;
  scene.materials = {Mirror(), lumifold::testing::Emitter({1, 1, 1})};
  lumifold::testing::Place(&scene, lumifold::testing::SphereMesh(0.5f, 12, 0));
  lumifold::testing::Place(&scene, lumifold::testing::SphereMesh(0.5f, 12, 0));
  scene.instances[1].world_from_object.origin = {0, 0, -400};
  lumifold::testing::PlaceBoxInside(&scene, 1000, {1, 1, 1, 1, 1, 1});
  scene.cameras = {lumifold::testing::LookAt({0, 0, 4}, {0, 0, 0}, 0.3f)};
  const Plan plan = PlanOf(scene);
  EXPECT_EQ(ValueOf(plan, "levels"), "1");
  EXPECT_EQ(Find(plan, "levels").source, Source::kProbe);
}

TEST(PlanRules, UnlitMaterialsNeedEmissionAlone) {
  Material unlit = Gray();
  unlit.unlit = true;
  const Plan plan = PlanOf(Box(unlit));
  EXPECT_EQ(Values(plan, kLayers), (Strings{"off", "off", "off", "on", "off"}));
  EXPECT_EQ(Values(plan, {"bounces", "levels", "emission-on-hits"}), (Strings{"0", "0", "on"}));
  EXPECT_EQ(Find(plan, "bounces").reason, "no material scatters light");
}

TEST(PlanRules, ALoneEmitterNeedsEmissionAlone) {
  const Plan plan = PlanOf(Sheet(lumifold::testing::Emitter({1, 1, 1})));
  EXPECT_EQ(Values(plan, kLayers), (Strings{"off", "off", "off", "on", "off"}));
  EXPECT_EQ(ValueOf(plan, "bounces"), "0");
}

TEST(PlanRules, SurfacesInOnePlaneHaveNoIndirectLight) {
  const Plan sheet = PlanOf(Sheet(Gray()), SettingsFor(WhiteSky()));
  EXPECT_EQ(Values(sheet, {"bounces", "direct", "indirect", "emission"}), (Strings{"0", "on", "off", "on"}));
  Scene tilted = Sheet(Gray());
  lumifold::testing::Place(&tilted, lumifold::testing::QuadMesh({-1, -1, 0}, {2, 0, 0}, {0, 0, 2}, 0));
  EXPECT_EQ(ValueOf(PlanOf(tilted, SettingsFor(WhiteSky())), "bounces"), "8");
}

TEST(PlanRules, TheScaleOfASceneChangesNothing) {
  for (const Scene& scene : {LitBox(Gray()), Sheet(Gray()), LitBox(Mirror()), Generated("meeting-room")}) {
    const PlanSettings settings = SettingsFor(WhiteSky());
    const Plan plan = PlanOf(scene, settings);
    for (const float factor : {1e-3f, 1e5f}) {
      const Plan scaled = PlanOf(lumifold::testing::Scaled(scene, factor), settings);
      for (const Decision& decision : plan.decisions) {
        EXPECT_EQ(Find(scaled, decision.name).value, decision.value) << decision.name << " at " << factor;
      }
    }
  }
}

TEST(PlanRules, PunctualLightsAreNotHitByRays) {
  Scene room = Box(Gray());
  room.lights = {Bulb()};
  const Plan plan = PlanOf(room);
  EXPECT_EQ(Values(plan, {"direct", "emission", "emission-on-hits"}), (Strings{"on", "off", "off"}));
  EXPECT_FALSE(plan.tracing.emission_on_hits);
}

TEST(PlanRules, AnEnvironmentIsHitByRays) {
  const Plan plan = PlanOf(lumifold::testing::SmallRoom(), SettingsFor(WhiteSky()));
  EXPECT_EQ(Values(plan, {"emission", "emission-on-hits"}), (Strings{"on", "on"}));
}

TEST(PlanRules, WithoutLightThereIsNothingToScatter) {
  const Plan plan = PlanOf(Box(Gray()));
  EXPECT_EQ(Values(plan, kLayers), (Strings{"off", "off", "on", "off", "off"}));
  EXPECT_EQ(Find(plan, "bounces").reason, "nothing emits light");
}

TEST(PlanRules, TexturesAreScannedForTheValuesTheyTake) {
  Material metal = Mirror();
  metal.base.roughness = 1;
  // Green is roughness, blue is metallic.
  const auto with_texels = [&](const std::vector<uint8_t>& rgba) {
    Scene room = LitBox(metal);
    room.materials[0].base.metallic_roughness_texture.texture = AddTexture(rgba, &room);
    return PlanOf(room);
  };
  EXPECT_EQ(Values(with_texels({0, 200, 255, 255, 0, 100, 255, 255}), {"levels", "glossy", "direct"}),
            (Strings{"0", "on", "off"}));
  const Plan partly_smooth = with_texels({0, 200, 255, 255, 0, 3, 255, 255});
  EXPECT_EQ(Values(partly_smooth, {"glossy", "direct"}), (Strings{"on", "off"}));
  EXPECT_NE(ValueOf(partly_smooth, "levels"), "0");
  EXPECT_EQ(Values(with_texels({0, 0, 255, 255}), {"levels", "glossy", "direct"}),  // one texel
            (Strings{"3", "off", "off"}));
  EXPECT_EQ(Values(with_texels({0, 200, 0, 255}), {"levels", "glossy", "direct"}),
            (Strings{"0", "on", "on"}));  // no metal: a dielectric with its highlight
  metal.specular.factor = 0;
  EXPECT_EQ(Values(with_texels({0, 0, 0, 255}), {"levels", "glossy", "direct"}), (Strings{"0", "off", "on"}));
}

TEST(PlanRules, AlphaModesAreIgnoredWhereEveryTexelIsOpaque) {
  for (const scene::AlphaMode mode : {scene::AlphaMode::kMask, scene::AlphaMode::kBlend}) {
    Scene room = LitBox(Gray());
    room.materials[0].alpha_mode = mode;
    room.materials[0].base.color_texture.texture = AddTexture({9, 9, 9, 255, 99, 99, 99, 255}, &room);
    EXPECT_THAT(Find(PlanOf(room), "alpha-by-mode").saving, HasSubstr("6 surfaces"));
    room.materials[0].base.color_texture.texture = AddTexture({9, 9, 9, 255, 99, 99, 99, 100}, &room);
    EXPECT_EQ(Find(PlanOf(room), "alpha-by-mode").saving, "");
  }
}

TEST(PlanRules, AMirrorThatAppearsAtFrame30IsPlannedForFromTheStart) {
  const auto first = RoomWithLateMirror().Load();
  ASSERT_TRUE(first.ok()) << first.status();
  ASSERT_TRUE(first->animated);
  ASSERT_EQ(first->instances.size(), 2u) << "the mirror is hidden";
  const Plan plan = PlanOf(*first);
  EXPECT_EQ(ValueOf(plan, "levels"), "3");
  EXPECT_THAT(Find(plan, "levels").reason, HasSubstr("'late'"));
  EXPECT_EQ(ValueOf(plan, "general-code"), "on");
}

TEST(PlanRules, AnEmptySceneAndASkyNeedNothingButEmission) {
  Scene empty;
  EXPECT_EQ(Values(PlanOf(empty), kLayers), (Strings{"off", "off", "off", "off", "off"}));
  Scene away = Sheet(Gray());
  away.cameras = {lumifold::testing::LookAt({0, 0, 4}, {0, 0, 8}, 0.6f)};
  const Plan sky = PlanOf(away, SettingsFor(WhiteSky()));
  EXPECT_EQ(Values(sky, {"emission", "bounces"}), (Strings{"on", "0"}));
}

TEST(PlanRules, UnitsTakeLongEnough) {
  PlanSettings settings = SettingsFor();
  settings.render.width = settings.render.height = 1024;
  const auto with = [&](int samples, double rays_per_second) {
    settings.samples = samples;
    settings.rays_per_second = rays_per_second;
    return PlanOf(LitBox(Gray()), settings).units;
  };
  const double rays_per_sample = RunProbe(LitBox(Gray()), settings.render, kAmpleSamples)->RaysPerSample();
  const UnitPlan fast = with(64, 1e12);
  EXPECT_EQ(fast.tile_size, 128) << "short passes get large tiles";
  EXPECT_EQ(fast.pass_samples, 256) << "and more samples";
  EXPECT_EQ(with(64, 1e3).pass_samples, 64) << "the default is the least: each pass costs its bytes";
  for (const int samples : {1, 63, 1024}) {
    EXPECT_EQ(with(samples, 1e12).pass_samples, 256) << "samples that are added keep the units";
    EXPECT_EQ(with(samples, 1e12).tile_size, 128);
  }
  const double unit = 64 * 32 * 32 * rays_per_sample;
  EXPECT_EQ(with(64, unit / (0.9 * kMinUnitSeconds)).tile_size, 64);
  EXPECT_EQ(with(64, unit / (1.1 * kMinUnitSeconds)).tile_size, 32);
  EXPECT_EQ(with(4096, 1e3).pass_samples, 256) << "at most 16 passes";
  EXPECT_EQ(with(1024, 1e3).tile_size, 32) << "on a slow machine a small tile takes long enough";
}

TEST(PlanRules, ManyFramesAreSharedByFrames) {
  PlanSettings settings = SettingsFor();
  settings.render.width = 1024;
  settings.render.height = 768;  // 48 tiles of 128x128
  settings.rays_per_second = 1e12;
  EXPECT_EQ(PlanOf(LitBox(Gray()), settings).units.tile_size, 64);
  settings.frames = 2;
  EXPECT_EQ(PlanOf(LitBox(Gray()), settings).units.tile_size, 128);
}

TEST(PlanRules, CostlyTilesComeFirst) {
  PlanSettings settings = SettingsFor(WhiteSky());
  settings.render.width = 256;
  settings.render.height = 192;
  Scene scene = lumifold::testing::SmallRoom();
  scene.cameras = {lumifold::testing::LookAt({0, 0, 30}, {0, 0, 0}, 0.6f)};  // a small box before the sky
  scene.instances.erase(scene.instances.begin() + 3);                        // without its front
  const Plan plan = PlanOf(scene, settings);
  ASSERT_EQ(ValueOf(plan, "costliest-first"), "on");
  const std::set<int> tiles(plan.units.tile_order.begin(), plan.units.tile_order.end());
  ASSERT_EQ(tiles.size(), 48u);
  EXPECT_EQ(*tiles.rbegin(), 47);
  const int column = plan.units.tile_order.front() % 8;
  const int row = plan.units.tile_order.front() / 8;
  EXPECT_TRUE(column == 3 || column == 4) << column;
  EXPECT_TRUE(row == 2 || row == 3) << row;
  EXPECT_TRUE(PlanOf(LitBox(Gray()), settings).units.tile_order.empty()) << "all tiles cost about the same";
  settings.forced = {"tile-size=32"};
  static_assert(kProbePixels == 64 * 64);
  settings.render.width = settings.render.height = 64 * 32;
  EXPECT_EQ(PlanOf(scene, settings).units.tile_order.size(), size_t{kProbePixels})
      << "no more tiles than pixels";
  settings.render.width += 1;
  EXPECT_TRUE(PlanOf(scene, settings).units.tile_order.empty()) << "a column more";
  settings.render.width = settings.render.height = 8192;
  EXPECT_TRUE(PlanOf(scene, settings).units.tile_order.empty()) << "more tiles than the probe has pixels";
  settings.forced.emplace_back("costliest-first=on");
  EXPECT_TRUE(PlanOf(scene, settings).units.tile_order.empty()) << "also where it is asked for";
}

TEST(PlanRules, FullModelsEverything) {
  PlanSettings settings = SettingsFor();
  settings.full = true;
  settings.render.max_bounces = 5;
  const Plan plan = PlanOf(Sheet(lumifold::testing::Emitter({1, 1, 1})), settings);
  EXPECT_EQ(plan.tracing, render::TracingPlan{});
  EXPECT_EQ(plan.max_bounces, 5);
  EXPECT_EQ(plan.units.tile_size, UnitPlan{}.tile_size);
  EXPECT_EQ(plan.units.pass_samples, UnitPlan{}.pass_samples);
  EXPECT_TRUE(plan.units.tile_order.empty());
  for (const Decision& decision : plan.decisions) EXPECT_EQ(decision.source, Source::kFull) << decision.name;
}

TEST(PlanRules, DecisionsCanBeForced) {
  PlanSettings settings = SettingsFor();
  settings.forced = {"levels=2", "glossy=on", "tile-size=16"};
  const Plan plan = PlanOf(LitBox(Gray()), settings);
  EXPECT_EQ(plan.tracing.levels, 2);
  EXPECT_TRUE(plan.tracing.layers.glossy);
  EXPECT_EQ(plan.units.tile_size, 16);
  EXPECT_EQ(Find(plan, "levels").source, Source::kForced);
  EXPECT_EQ(Find(plan, "levels").reason,
            "asked for; otherwise 0: no material is a perfect mirror or smooth glass");
  settings.full = true;
  EXPECT_EQ(ValueOf(PlanOf(LitBox(Gray()), settings), "levels"), "2");
}

TEST(PlanRules, WhatCannotBeForcedIsNamed) {
  const Scene room = LitBox(Gray());
  PlanSettings settings = SettingsFor();
  const auto probe = RunProbe(room, settings.render, kAmpleSamples);
  ASSERT_TRUE(probe.ok());
  const auto error_of = [&](const std::string& forced) {
    settings.forced = {forced};
    const auto plan = MakePlan(room, settings, *probe);
    EXPECT_EQ(plan.status().code(), absl::StatusCode::kInvalidArgument) << forced;
    return std::string(plan.status().message());
  };
  EXPECT_THAT(error_of("speed=9"), HasSubstr("bounces, levels, direct"));
  EXPECT_THAT(error_of("levels"), HasSubstr("'levels' is not NAME=VALUE"));
  EXPECT_EQ(error_of("levels=4"), "'levels=4': levels is a whole number from 0 to 3");
  EXPECT_EQ(error_of("glossy=1"), "'glossy=1': glossy is on or off");
  EXPECT_EQ(error_of("tile-size=many"), "'tile-size=many': tile-size is a whole number from 8 to 512");
}

TEST(PlanRules, NamesOfMaterialsStayOnTheirLine) {
  Material glossy = Glossy();
  glossy.name = "two\nlines\x1b[2J";
  const std::string text = TextOf(PlanOf(LitBox(glossy)));
  EXPECT_EQ(text.find('\x1b'), std::string::npos);
  EXPECT_EQ(text.find("two\n"), std::string::npos);
}

}  // namespace
}  // namespace lumifold::plan
