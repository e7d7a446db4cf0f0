#include "tests/unit/plan/plan_scenes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "filter/image/check.h"
#include "filter/image/decisions.h"
#include "tests/support/analytic_scenes.h"

namespace lumifold::plan {

using scene::Material;
using scene::Scene;

Material Mirror() {
  Material mirror;
  mirror.name = "mirror";
  mirror.base.color = {0.9f, 0.9f, 0.9f};
  mirror.base.roughness = 0;
  return mirror;
}

Material ClearPane() {
  Material pane;
  pane.name = "pane";
  pane.base.metallic = 0;
  pane.base.roughness = 0;
  pane.transmission.factor = 1;
  return pane;
}

Scene Box(const Material& walls) {
  Scene scene;
  scene.materials = {walls};
  testing::PlaceBoxInside(&scene, 2, {0, 0, 0, 0, 0, 0});
  scene.cameras = {testing::LookAt({0, 0, 1.9f}, {0, -0.3f, 0}, 1.2f)};
  return scene;
}

Scene LitBox(const Material& walls) {
  Scene scene = Box(walls);
  scene.materials.push_back(testing::Emitter({12, 11, 9}));
  testing::Place(&scene, testing::QuadMesh({-0.5f, 1.95f, -0.5f}, {1, 0, 0}, {0, 0, 1}, 1));
  return scene;
}

Scene Sheet(const Material& material) {
  Scene scene;
  scene.materials = {material};
  testing::Place(&scene, testing::QuadMesh({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 4}, {0, 0, 0}, 0.6f)};
  return scene;
}

scene::GltfFixture RoomWithLateMirror() {
  scene::GltfFixture fixture;
  const int gray =
      fixture.Add("materials", {{"extensions", {{"KHR_materials_specular", {{"specularFactor", 0}}}}},
                                {"pbrMetallicRoughness", {{"metallicFactor", 0}}}});
  const int lamp =
      fixture.Add("materials", {{"emissiveFactor", {1, 1, 1}},
                                {"pbrMetallicRoughness", {{"metallicFactor", 0}}},
                                {"extensions", {{"KHR_materials_specular", {{"specularFactor", 0}}}}}});
  const int mirror =
      fixture.Add("materials", {{"name", "late"}, {"pbrMetallicRoughness", {{"roughnessFactor", 0}}}});
  fixture.json["extensionsUsed"] = {"KHR_materials_specular"};
  fixture.AddTriangles({-2, -1, -2, 2, -1, -2, 0, -1, 2}, {{"material", gray}});
  fixture.AddTriangles({-2, 2, -2, 0, 2, 2, 2, 2, -2}, {{"material", lamp}});
  fixture.AddTriangles(scene::kTriangle, {{"material", mirror}});
  const int node = static_cast<int>(fixture.json["nodes"].size()) - 1;
  const int times = fixture.AddFloats({0, 1.25f}, "SCALAR");
  const int scales = fixture.AddFloats({0, 0, 0, 1, 1, 1}, "VEC3");
  fixture.json["animations"] = {
      {{"channels", {{{"sampler", 0}, {"target", {{"node", node}, {"path", "scale"}}}}}},
       {"samplers", {{{"input", times}, {"output", scales}, {"interpolation", "STEP"}}}}}};
  return fixture;
}

std::shared_ptr<const render::Environment> WhiteSky() {
  LayeredImage picture(4, 2);
  const ColorView color = picture.AddColor(layers::kBeauty);
  for (const FloatView& channel : color) {
    for (int y = 0; y < 2; ++y) std::fill_n(channel.Row(y), 4, 1.0f);
  }
  const auto sky = render::Environment::Create(picture, 0, 1);
  LUMIFOLD_CHECK(sky.ok());
  return *sky;
}

int AddTexture(const std::vector<uint8_t>& rgba, Scene* scene) {
  scene::ImageData image;
  image.width = static_cast<int>(rgba.size() / 4);
  image.height = 1;
  image.rgba = rgba;
  scene->images.push_back(std::make_shared<const scene::ImageData>(std::move(image)));
  scene::Texture texture;
  texture.image = static_cast<int>(scene->images.size()) - 1;
  scene->textures.push_back(texture);
  for (scene::Mesh& mesh : scene->meshes) {
    mesh.uvs[0].clear();
    for (size_t i = 0; i < mesh.positions.size(); ++i)
      mesh.uvs[0].push_back({static_cast<float>(i % 2), static_cast<float>(i / 2 % 2)});
  }
  return static_cast<int>(scene->textures.size()) - 1;
}

PlanSettings SettingsFor(std::shared_ptr<const render::Environment> sky) {
  PlanSettings settings;
  settings.render.width = 64;
  settings.render.height = 48;
  settings.render.environment = std::move(sky);
  return settings;
}

Plan PlanOf(const Scene& scene, const PlanSettings& settings) {
  const auto probe = RunProbe(scene, settings.render, kAmpleSamples);
  LUMIFOLD_CHECK(probe.ok());
  auto plan = MakePlan(scene, settings, *probe);
  LUMIFOLD_CHECK(plan.ok());
  return *std::move(plan);
}

const Decision& Find(const Plan& plan, const std::string& name) {
  const auto found = std::find_if(plan.decisions.begin(), plan.decisions.end(),
                                  [&](const Decision& decision) { return decision.name == name; });
  LUMIFOLD_CHECK(found != plan.decisions.end());
  return *found;
}

std::string ValueOf(const Plan& plan, const std::string& name) {
  return decisions::ValueText(*decisions::Find(name), Find(plan, name).value);
}

std::string TextOf(const Plan& plan) {
  std::string text = absl::StrCat(plan.probe_rays, " ", plan.noise, " ", plan.seconds_per_sample, " ",
                                  absl::StrJoin(plan.units.tile_order, ","));
  for (const Decision& decision : plan.decisions) {
    absl::StrAppend(&text, "\n", decision.name, "=", ValueOf(plan, decision.name), " ",
                    static_cast<int>(decision.source), " ", decision.reason, " ", decision.saving);
  }
  return text;
}

}  // namespace lumifold::plan
