// A plan leaves out only what the scene does not need: the planned picture has the bits of the full one, and
// the channels that it lacks are 0 there.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/analytic_scenes.h"
#include "tests/unit/plan/plan_scenes.h"
#include "tests/unit/render/pictures.h"

namespace lumifold::plan {
namespace {

using scene::Material;
using scene::Scene;

struct NamedScene {
  std::string name;
  Scene scene;
  bool sky = false;
};

Material Brownish() { return lumifold::testing::Lambert({0.6f, 0.5f, 0.4f}); }

Scene TexturedRoom(scene::AlphaMode mode, uint8_t alpha) {
  Scene room = LitBox(Brownish());
  room.materials.push_back(Brownish());
  room.materials[2].alpha_mode = mode;
  lumifold::testing::Place(&room, lumifold::testing::QuadMesh({-1, -1, -0.5f}, {2, 0, 0}, {0, 2, 0}, 2));
  const int texture = AddTexture({200, 90, 30, 255, 20, 90, 200, alpha, 90, 90, 90, 255}, &room);
  room.materials[2].base.color_texture.texture = texture;
  return room;
}

/// A sheet of the box whose material has this texel, alone, as its metallic-roughness picture: a mirror if it
/// is black in its roughness and white in its metallic channel.
Scene RoomWithOneTexel(const std::vector<uint8_t>& texel) {
  Scene room = LitBox(Brownish());
  Material metal = Mirror();
  metal.base.roughness = 1;
  room.materials.push_back(metal);
  lumifold::testing::Place(&room, lumifold::testing::QuadMesh({-1, -1, -0.5f}, {2, 0, 0}, {0, 2, 0}, 2));
  const int texture = AddTexture(texel, &room);
  room.materials[2].base.metallic_roughness_texture.texture = texture;
  return room;
}

/// A lamp that the camera sees through a pane alone.
Scene EmitterBehindGlass() {
  Scene room = LitBox(Brownish());
  room.materials.push_back(ClearPane());
  lumifold::testing::Place(&room,
                           lumifold::testing::QuadMesh({-0.6f, -0.6f, -1.5f}, {1.2f, 0, 0}, {0, 1.2f, 0}, 1));
  lumifold::testing::Place(&room,
                           lumifold::testing::QuadMesh({-1.8f, -1.8f, -1}, {3.6f, 0, 0}, {0, 3.6f, 0}, 2));
  return room;
}

/// Scenes in which the plan leaves out nothing that contributes.
std::vector<NamedScene> Scenes() {
  Material unlit = Brownish();
  unlit.unlit = true;
  Scene bulb = Box(Brownish());
  bulb.lights.emplace_back();
  bulb.lights[0].world_from_light.origin = {0, 1, 1};
  Scene sheet_and_bulb = Sheet(Brownish());
  sheet_and_bulb.lights = bulb.lights;
  Scene one_mirror = LitBox(Brownish());
  one_mirror.materials.push_back(Mirror());
  lumifold::testing::Place(&one_mirror,
                           lumifold::testing::QuadMesh({-1, -1, -1.9f}, {2, 0, 0}, {0, 2, 0}, 2));
  Scene pane = LitBox(Brownish());
  pane.materials.push_back(ClearPane());
  lumifold::testing::Place(&pane, lumifold::testing::QuadMesh({-1, -1, -0.5f}, {2, 0, 0}, {0, 2, 0}, 2));
  return {
      {"diffuse room", LitBox(Brownish())},
      {"diffuse room under a sky", LitBox(Brownish()), true},
      {"glossy and mirror room", lumifold::testing::SmallRoom()},
      {"hall of mirrors", LitBox(Mirror())},
      {"one flat mirror", one_mirror},
      {"a pane", pane},
      {"unlit", Box(unlit)},
      {"emitter only", Sheet(lumifold::testing::Emitter({3, 2, 1}))},
      {"sheet under a sky", Sheet(Brownish()), true},
      {"mirror sheet under a sky", Sheet(Mirror()), true},
      {"sheet and bulb", sheet_and_bulb},
      {"room and bulb", bulb},
      {"no light", Box(Brownish())},
      {"textured", TexturedRoom(scene::AlphaMode::kOpaque, 255)},
      {"mask without holes", TexturedRoom(scene::AlphaMode::kMask, 200)},
      {"mask with holes", TexturedRoom(scene::AlphaMode::kMask, 0)},
      {"blend of 255", TexturedRoom(scene::AlphaMode::kBlend, 255)},
      {"blend", TexturedRoom(scene::AlphaMode::kBlend, 100)},
      {"one texel makes a mirror", RoomWithOneTexel({0, 0, 255, 255})},
      {"one texel makes rough metal", RoomWithOneTexel({0, 128, 255, 255})},
      {"an emitter behind glass", EmitterBehindGlass()},
      {"tiny", lumifold::testing::Scaled(LitBox(Brownish()), 1e-3f)},
      {"huge", lumifold::testing::Scaled(LitBox(Brownish()), 1e5f)},
      {"empty", Scene(), true},
  };
}

constexpr int kPictureWidth = 32;
constexpr int kPictureHeight = 24;

/// The picture of the full plan, which is rendered once for all tests.
const LayeredImage& FullPicture(const NamedScene& named) {
  static std::map<std::string, LayeredImage> pictures;
  const auto [entry, is_new] = pictures.try_emplace(named.name);
  if (is_new) {
    const auto renderer =
        render::MakeRenderer(named.scene, SettingsFor(named.sky ? WhiteSky() : nullptr).render);
    entry->second = render::RenderAll(*renderer, kPictureWidth, kPictureHeight, 10);
  }
  return entry->second;
}

TEST(SameBits, ThePlannedPictureIsTheFullOne) {
  for (const NamedScene& named : Scenes()) {
    SCOPED_TRACE(named.name);
    const PlanSettings settings = SettingsFor(named.sky ? WhiteSky() : nullptr);
    const Plan plan = PlanOf(named.scene, settings);
    render::RenderSettings planned = settings.render;
    planned.plan = plan.tracing;
    planned.max_bounces = plan.max_bounces;
    const auto full_renderer = render::MakeRenderer(named.scene, settings.render);
    const auto plan_renderer = render::MakeRenderer(named.scene, planned);
    const LayeredImage& full = FullPicture(named);
    const LayeredImage pass = render::RenderAll(*plan_renderer, kPictureWidth, kPictureHeight, 10);
    render::ExpectSameBits(full, pass);
    EXPECT_LE(pass.channels().size(), full.channels().size());
    const Rect frame = {0, 0, kPictureWidth, kPictureHeight};
    const EdgedImage geometry = plan_renderer->RenderGeometry(frame, 0);
    const EdgedImage full_geometry = full_renderer->RenderGeometry(frame, 0);
    render::ExpectSameBits(full_geometry.pixels, geometry.pixels);
    render::ExpectSameBits(full_geometry.edges, geometry.edges);
  }
}

TEST(SameBits, AMirrorThatAppearsAtFrame30IsInThePictureOfThatFrame) {
  const scene::GltfFixture fixture = RoomWithLateMirror();
  const auto first = fixture.Load();
  scene::LoadOptions at_frame_30;
  at_frame_30.time_seconds = 1.25;
  const auto late = fixture.Load(at_frame_30);
  ASSERT_TRUE(first.ok() && late.ok());
  ASSERT_GT(late->instances.size(), first->instances.size());
  const Plan plan = PlanOf(*first, SettingsFor(WhiteSky()));
  render::RenderSettings settings = SettingsFor(WhiteSky()).render;
  const LayeredImage full = render::RenderAll(*render::MakeRenderer(*late, settings), 64, 48, 10);
  settings.plan = plan.tracing;
  settings.max_bounces = plan.max_bounces;
  const LayeredImage pass = render::RenderAll(*render::MakeRenderer(*late, settings), 64, 48, 10);
  render::ExpectSameBits(full, pass);
  EXPECT_TRUE(pass.Has("reflection1_emission.R")) << "the mirror shows the sky";
}

TEST(SameBits, AnEmitterBehindGlassIsInALevel) {
  const Plan plan = PlanOf(EmitterBehindGlass());
  render::RenderSettings settings = SettingsFor().render;
  settings.plan = plan.tracing;
  const LayeredImage pass =
      render::RenderAll(*render::MakeRenderer(EmitterBehindGlass(), settings), 64, 48, 10);
  ASSERT_TRUE(pass.Has("transmission1_emission.G"));
  double sum = 0;
  for (int y = 14; y < 22; ++y) {
    for (int x = 28; x < 36; ++x) sum += static_cast<double>(pass.Get("transmission1_emission.G").At(x, y));
  }
  EXPECT_GT(sum / 64, 10 * 0.85 * 11) << "of 10 samples of radiance 11";
}

TEST(SameBits, CodeThatIsLeftOutChangesNothing) {
  for (const NamedScene& named : Scenes()) {
    SCOPED_TRACE(named.name);
    render::RenderSettings settings = SettingsFor(named.sky ? WhiteSky() : nullptr).render;
    const Plan plan = PlanOf(named.scene, SettingsFor(named.sky ? WhiteSky() : nullptr));
    Plan code;
    for (const char* name : {"general-code", "emission-on-hits", "alpha-by-mode"})
      Apply(name, Find(plan, name).value, &code);
    settings.plan = code.tracing;
    const LayeredImage exact =
        render::RenderAll(*render::MakeRenderer(named.scene, settings), kPictureWidth, kPictureHeight, 10);
    render::ExpectSameBits(FullPicture(named), exact);
    EXPECT_EQ(exact.channels().size(), FullPicture(named).channels().size());
  }
}

TEST(SameBits, ADiffuseRoomHasAQuarterFewerChannels) {
  const Plan plan = PlanOf(LitBox(Brownish()));
  render::RenderSettings planned = SettingsFor().render;
  const auto channels = [&] {
    return render::RenderAll(*render::MakeRenderer(LitBox(Brownish()), planned), 64, 48, 2).channels().size();
  };
  const size_t full = channels();
  planned.plan = plan.tracing;
  EXPECT_LE(4 * channels(), 3 * full);
}

TEST(SameBits, LevelsThatAreLeftOutAreStillInC) {
  // Unbiased, not the same bits: the light of deeper levels is gathered by the general code.
  const Scene hall = LitBox(Mirror());
  render::RenderSettings settings = SettingsFor().render;
  const auto mean_of = [&](int levels) {
    settings.plan.levels = levels;
    const LayeredImage pass = render::RenderAll(*render::MakeRenderer(hall, settings), 64, 48, 64);
    EXPECT_EQ(pass.Has("reflection1_emission.R"), levels > 0);
    return render::MeanOf(pass, layers::kNoisy);
  };
  const double full = mean_of(layers::kMaxDepth);
  for (const int levels : {0, 1, 2}) EXPECT_NEAR(mean_of(levels), full, 0.01 * full) << levels;
}

}  // namespace
}  // namespace lumifold::plan
