#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "absl/functional/function_ref.h"
#include "filter/image/layers.h"
#include "tests/charts/access/charts_access.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/levels.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::Material;
using scene::Vec3;

Material Mirror(float reflectance) {
  Material mirror;
  mirror.base.color = {reflectance, reflectance, reflectance};
  mirror.base.roughness = 0;
  return mirror;
}

Material Glass(bool has_volume) {
  Material glass;
  glass.base.metallic = 0;
  glass.base.roughness = 0;
  glass.transmission.factor = 1;
  glass.volume.is_solid = has_volume;
  glass.volume.attenuation_color = {0.8f, 0.9f, 0.7f};
  glass.volume.attenuation_distance = 0.5f;
  return glass;
}

Material Polished() {
  Material polished;
  polished.base.color = {0.6f, 0.5f, 0.4f};
  polished.base.metallic = 0;
  polished.base.roughness = 0;
  return polished;
}

/// A room whose ball has the material `ball`, and whose left and right walls have `walls`.
scene::Scene RoomOf(const Material& ball, const Material* walls = nullptr) {
  scene::Scene room = testing::SmallRoom();
  room.materials[5] = ball;
  if (walls != nullptr) room.materials[1] = room.materials[2] = *walls;
  return room;
}

std::vector<std::pair<std::string, scene::Scene>> Rooms() {
  const Material hall = Mirror(0.8f);
  const Material polished = Polished();
  Material frosted_mix = Glass(false);
  frosted_mix.transmission.factor = 0.5f;  // half of it a diffuse base
  Material metal = Mirror(0.9f);
  metal.base.roughness = 0.4f;
  return {
      {"mirror ball", testing::SmallRoom()}, {"mirror facing mirror", RoomOf(metal, &hall)},
      {"glass ball", RoomOf(Glass(true))},   {"thin glass in a hall of mirrors", RoomOf(Glass(false), &hall)},
      {"half glass", RoomOf(frosted_mix)},   {"glossy metal, polished walls", RoomOf(metal, &polished)}};
}

void ForEachSample(const Renderer& renderer, const Rect& rect, uint32_t spp,
                   absl::FunctionRef<void(const SampleRecord&)> visit) {
  ChartsAccess(renderer).TraceSamples(rect, 0, {0, spp}, visit);
}

/// Sum of a channel over all pixels; 0 if the unit does not have it.
double SumOf(const LayeredImage& image, const std::string& channel) {
  double sum = 0;
  if (!image.Has(channel)) return sum;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) sum += static_cast<double>(image.Get(channel).At(x, y));
  }
  return sum;
}

/// A camera at the origin that looks at a plane of material `mirror` 3 m ahead; 2 m behind the camera is a
/// wall of material `wall`.
scene::Scene WallInAMirror(const Material& wall, const Material& mirror) {
  scene::Scene scene;
  scene.materials = {mirror, wall, testing::Emitter({5, 5, 5})};
  testing::Place(&scene, testing::QuadMesh({-2, -2, -3}, {4, 0, 0}, {0, 4, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-9, -9, 2}, {0, 18, 0}, {18, 0, 0}, 1));
  testing::Place(&scene, testing::QuadMesh({-1, 4, 0}, {2, 0, 0}, {0, 0, 1}, 2));  // a light over both
  scene.cameras = {testing::LookAt({0, 0, 0}, {0, 0, -1}, 0.2f)};
  return scene;
}

/// (D + I) T + E + G S + levels + remainder.
Vec3 Recombined(const LayerSample& s) {
  Vec3 sum = (s.direct + s.indirect) * s.albedo + s.emitted + s.glossy * s.glossy_albedo + s.remainder;
  s.levels.ForEach([&](layers::Level, const LevelSample& level) {
    sum += (level.direct + level.indirect) * level.albedo + level.emitted;
  });
  return sum;
}

TEST(Layers, EverySampleEqualsItsRecombinedLayers) {
  for (const auto& [name, room] : Rooms()) {
    const auto renderer = MakeRenderer(room, SettingsOf(32, 24));
    int64_t count = 0;
    ForEachSample(*renderer, {0, 0, 32, 24}, 8, [&, room_name = name](const SampleRecord& record) {
      ++count;
      const Vec3 sum = Recombined(record.layers);
      for (int c = 0; c < 3; ++c) {
        const float whole = record.layers.combined[c];
        ASSERT_NEAR(sum[c], whole, 1e-5f * (1 + whole))
            << room_name << ": pixel " << record.pixel << " sample " << record.index;
      }
    });
    EXPECT_EQ(count, 32 * 24 * 8);
  }
}

TEST(Layers, TheRemainderIsSmall) {
  for (const auto& [name, room] : Rooms()) {
    double remainder = 0;
    double whole = 0;
    ForEachSample(*MakeRenderer(room, SettingsOf(32, 24)), {0, 0, 32, 24}, 8,
                  [&](const SampleRecord& record) {
                    remainder += static_cast<double>(record.layers.remainder.y);
                    whole += static_cast<double>(record.layers.combined.y);
                  });
    EXPECT_LT(remainder, 0.12 * whole) << name;
  }
}

TEST(Layers, AUnitIsTheSumOfItsSamples) {
  const Material glowing = testing::Emitter({0.5f, 0.3f, 0.2f});
  const auto renderer = MakeRenderer(RoomOf(Glass(true), &glowing), SettingsOf(24, 18));
  RenderCounts counts;
  const Rect rect = {1, 2, 24, 18};
  const LayeredImage unit = renderer->RenderPass(rect, 0, {0, 6}, &counts).pixels;
  std::map<std::string, double> expected;  // by channel
  for (const LayeredImage::Channel& channel : unit.channels()) expected[channel.name] = 0;
  ForEachSample(*renderer, rect, 6, [&](const SampleRecord& record) {
    const auto add = [&](std::string_view layer, Vec3 value) {
      for (size_t c = 0; c < 3; ++c)
        expected[layers::ColorChannels(layer)[c]] += static_cast<double>(value[static_cast<int>(c)]);
    };
    const bool is_a = record.index % 2 == 0;
    const auto half_of = [&](std::string_view layer) {
      return is_a ? layers::HalfA(layer) : layers::HalfB(layer);
    };
    const std::string_view samples = is_a ? layers::kSamplesA : layers::kSamplesB;
    const LayerSample& sample = record.layers;
    add(half_of(layers::kNoisy), sample.combined);
    add(half_of(layers::kDirect), sample.direct);
    add(half_of(layers::kIndirect), sample.indirect);
    add(half_of(layers::kGlossy), sample.glossy);
    add(layers::kAlbedo, sample.albedo);
    add(layers::kEmission, sample.emitted);
    add(layers::kGlossyAlbedo, sample.glossy_albedo);
    expected[std::string(samples)] += 1;
    sample.levels.ForEach([&](layers::Level level, const LevelSample& seen) {
      add(half_of(layers::OfLevel(level, layers::kDirect)), seen.direct);
      add(half_of(layers::OfLevel(level, layers::kIndirect)), seen.indirect);
      add(layers::OfLevel(level, layers::kAlbedo), seen.albedo);
      add(layers::OfLevel(level, layers::kEmission), seen.emitted);
      expected[layers::OfLevel(level, samples)] += seen.has_diffuse ? 1 : 0;
    });
  });
  for (const auto& [channel, sum] : expected)
    EXPECT_NEAR(SumOf(unit, channel), sum, 1e-4 * (1 + sum)) << channel;
  EXPECT_GT(expected["transmission2_albedo.B"], 0);
  EXPECT_GT(expected["reflection1_emission.G"], 0);
}

TEST(Layers, AUnitWithoutMirrorsHasNoLevels) {
  scene::Scene matt = RoomOf(testing::Lambert({0.5f, 0.5f, 0.5f}));
  RenderCounts counts;
  const auto renderer = MakeRenderer(std::move(matt), SettingsOf(24, 18));
  const LayeredImage unit = renderer->RenderPass({0, 0, 24, 18}, 0, {0, 2}, &counts).pixels;
  EXPECT_EQ(unit.channels().size(), 2 * 3 * layers::kHalved.size() + 3 * layers::kWhole.size() + 2);
  const LayeredImage geometry = renderer->RenderGeometry({0, 0, 24, 18}, 0).pixels;
  EXPECT_EQ(geometry.channels().size(), layers::kLevelFeatures.size() + 3);
}

TEST(Layers, GlassSeenFirstHasBothBranchesInEverySample) {
  const auto renderer =
      MakeRenderer(WallInAMirror(testing::Lambert({0.5f, 0.5f, 0.5f}), Glass(false)), SettingsOf(8, 8));
  ForEachSample(*renderer, {0, 0, 8, 8}, 4, [](const SampleRecord& record) {
    EXPECT_TRUE(record.layers.levels.IsSet(kReflection1));
    EXPECT_TRUE(record.layers.levels.IsSet(kTransmission1));
    // Fresnel's reflectance of a pane of index 1.5, both faces: 2 * 0.04 / 1.04; the wall's T is 0.5.
    EXPECT_NEAR(record.layers.levels[kReflection1].albedo.y, 0.5 * 0.0769, 2e-3);
  });
}

TEST(Layers, LayersAndRadianceEstimateTheSamePicture) {
  for (const auto& [name, room] : Rooms()) {
    const auto renderer = MakeRenderer(room, SettingsOf(16, 12));
    const double layered = MeanOf(RenderAll(*renderer, 16, 12, 128), layers::kNoisy);
    const double alone = MeanOf(RenderAllRadiance(*renderer, 16, 12, 128), layers::kNoisy);
    EXPECT_NEAR(layered, alone, 0.02 * alone) << name;
  }
}

TEST(Layers, ALampInTwoMirrorsIsEmissionOfTheSecondLevel) {
  scene::Scene scene;
  scene.materials = {Mirror(0.5f), testing::Emitter({3, 3, 3})};
  testing::Place(&scene, testing::QuadMesh({-1, -1, -3}, {2, 0, 0}, {0, 2, 0}, 0));
  testing::Place(&scene, testing::QuadMesh({-4, -4, 3}, {0, 8, 0}, {8, 0, 0}, 0));  // behind the camera
  testing::Place(&scene, testing::QuadMesh({-40, -40, -9}, {80, 0, 0}, {0, 80, 0}, 1));
  scene.cameras = {testing::LookAt({0, 0, 0}, {0.25f, 0, -1}, 0.05f)};
  // Path: the small mirror's right part, the large mirror, then past the small one to the lamp.
  const auto renderer = MakeRenderer(scene, SettingsOf(4, 4));
  ForEachSample(*renderer, {0, 0, 4, 4}, 2, [&](const SampleRecord& record) {
    ASSERT_EQ(record.geometry.instance, 0);
    ASSERT_TRUE(record.layers.levels.IsSet(kReflection2));
    EXPECT_FALSE(record.layers.levels.IsSet(kReflection3));
    EXPECT_NEAR(record.layers.levels[kReflection2].emitted.x, 0.25 * 3, 2e-3);
    EXPECT_FALSE(record.layers.levels[kReflection2].has_diffuse &&
                 record.layers.levels[kReflection2].albedo.x > 0);
    EXPECT_NEAR(record.layers.combined.x, 0.75, 2e-3);
  });
}

TEST(Layers, LightInAMirrorIsThatOfTheReflectedSurface) {
  const Material wall = testing::Lambert({0.5f, 0.5f, 0.5f});
  scene::Scene direct = WallInAMirror(wall, Mirror(0.5f));
  direct.cameras = {testing::LookAt({0, 0, -8}, {0, 0, 2}, 0.1f)};  // where the mirror shows the camera
  direct.instances[0].world_from_object.origin = {0, 50, 0};        // and nothing in between
  const LayeredImage seen = RenderAll(*MakeRenderer(std::move(direct), SettingsOf(8, 8)), 8, 8, 256);
  const double expected_direct = MeanOf(seen, layers::kDirect);
  ASSERT_GT(expected_direct, 0.01);
  // A polished surface samples the delta event rarely; its levels are no darker for that.
  for (const Material& mirror : {Mirror(0.5f), Polished(), Glass(false)}) {
    const LayeredImage unit =
        RenderAll(*MakeRenderer(WallInAMirror(wall, mirror), SettingsOf(8, 8)), 8, 8, 1024);
    const double samples = SumOf(unit, "reflection1_samples_a.Y") + SumOf(unit, "reflection1_samples_b.Y");
    const double light = SumOf(unit, "reflection1_direct_a.G") + SumOf(unit, "reflection1_direct_b.G");
    ASSERT_GT(samples, 0);
    EXPECT_NEAR(light / samples, expected_direct, 0.03 * expected_direct) << mirror.base.metallic;
    const double albedo = SumOf(unit, "reflection1_albedo.G") / (8 * 8 * 1024);
    const double reflectance = mirror.base.metallic == 1         ? 0.5
                               : mirror.transmission.factor == 1 ? 0.0769
                                                                 : 0.04;
    EXPECT_NEAR(albedo, 0.5 * reflectance, 0.02 * reflectance) << mirror.base.metallic;
  }
}

TEST(Layers, GlossyLightIsIndependentOfTheMetalsColour) {
  Material metal;
  metal.base.color = {0.9f, 0.6f, 0.2f};
  metal.base.roughness = 0.5f;
  const LayeredImage unit = RenderAll(*MakeRenderer(testing::Furnace(metal), SettingsOf(8, 8)), 8, 8, 512);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(MeanOf(unit, layers::kGlossy, c), 1, 0.03) << c;  // S is a table
  const double count = 8.0 * 8 * 512;
  EXPECT_NEAR(SumOf(unit, "glossy_albedo.B") / count, MeanOf(unit, layers::kNoisy, 2), 0.01);
}

TEST(Layers, ASampleIsNotFiniteIfAnyValueIsNot) {
  for (const float bad : {NAN, INFINITY, -INFINITY}) {
    LayerSample sample;
    EXPECT_TRUE(IsFinite(sample));
    sample.combined.x = 3e38f;
    EXPECT_TRUE(IsFinite(sample));
    sample.glossy_albedo.z = bad;
    EXPECT_FALSE(IsFinite(sample));
    sample.glossy_albedo.z = 0;
    sample.levels.Set(kReflection2).indirect.y = bad;
    EXPECT_FALSE(IsFinite(sample));
    sample.Clear();
    EXPECT_TRUE(IsFinite(sample));  // levels that are not set are ignored
  }
}

TEST(Layers, RecordsDescribeTheirSamples) {
  const auto renderer = MakeRenderer(testing::SmallRoom(), SettingsOf(24, 18));
  const Rect rect = {3, 4, 7, 6};
  int64_t expected = 0;
  ForEachSample(*renderer, rect, 2, [&](const SampleRecord& record) {
    const int x = rect.x0 + static_cast<int>(expected / 2 % rect.width());
    const int y = rect.y0 + static_cast<int>(expected / 2 / rect.width());
    ASSERT_EQ(record.pixel, y * 24 + x);
    ASSERT_EQ(record.index, expected % 2);
    const Vec2 jitter = Sampler(0, 0, record.pixel, record.index).Get2D(kCameraPair);
    ASSERT_FLOAT_EQ(record.point.x, static_cast<float>(x) + jitter.x);
    ASSERT_FLOAT_EQ(record.point.y, static_cast<float>(y) + jitter.y);
    ASSERT_EQ(record.geometry.albedo, record.layers.albedo);
    ASSERT_NEAR(record.geometry.distance, Length(record.geometry.position - Vec3{0, 0, 1.9f}), 1e-4);
    ++expected;
  });
  EXPECT_EQ(expected, 4 * 2 * 2);
}

}  // namespace
}  // namespace lumifold::render
