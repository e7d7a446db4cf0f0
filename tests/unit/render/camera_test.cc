#include "worker/render/geometry/camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "filter/image/layers.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

using scene::Vec3;
using ::testing::HasSubstr;

constexpr float kYfov = 0.6f;

scene::Camera Forward() { return testing::LookAt({0, 0, 0}, {0, 0, -1}, kYfov); }

/// The radius of the lens: half of focal length over f-stop; the sensor is 24 mm high.
double LensRadius(double f_stop) { return 0.012 / std::tan(static_cast<double>(kYfov) / 2) / (2 * f_stop); }

TEST(Camera, PinholeIgnoresTheLensPoint) {
  const PictureCamera camera(Forward(), {}, {40, 30});
  EXPECT_FALSE(camera.HasLens());
  const Ray a = camera.RayThrough(3.25f, 7, {0.1f, 0.9f});
  const Ray b = camera.RayThrough(3.25f, 7, {0.7f, 0.2f});
  EXPECT_EQ(a.origin, b.origin);
  EXPECT_EQ(a.direction, b.direction);
}

TEST(Camera, TheCornersOfTheFrameFollowItsAspect) {
  for (const auto kind : {scene::Camera::Kind::kPerspective, scene::Camera::Kind::kOrthographic}) {
    for (const auto& [width, height] : {std::pair{60, 20}, {20, 60}}) {
      scene::Camera description = Forward();
      description.kind = kind;
      description.ymag = 2;
      const bool is_perspective = kind == scene::Camera::Kind::kPerspective;
      const PictureCamera camera(description, {}, {width, height});
      const float tall = is_perspective ? std::tan(kYfov / 2) : description.ymag;  // half of it
      const float wide = tall * static_cast<float>(width) / static_cast<float>(height);
      const float pixel = 2 * tall / static_cast<float>(height);
      const PictureCamera::Matrix ndc = camera.WorldToNdc();
      for (const float x : {-1.0f, 1.0f}) {
        for (const float y : {-1.0f, 1.0f}) {
          const Ray ray = camera.RayThrough(static_cast<float>(width) * (1 + x) / 2,
                                            static_cast<float>(height) * (1 - y) / 2, {}, 3);
          const Vec3 seen = ray.origin + ray.direction * (1 / -ray.direction.z);
          EXPECT_NEAR(seen.x, x * wide, 1e-5f);
          EXPECT_NEAR(seen.y, y * tall, 1e-5f);
          EXPECT_NEAR(ray.WidthAt(1 / -ray.direction.z), 3 * pixel, 1e-6f);
          const auto projected = [&](size_t i) {
            return seen.x * ndc[i] + seen.y * ndc[4 + i] + seen.z * ndc[8 + i] + ndc[12 + i];
          };
          EXPECT_NEAR(projected(0) / projected(3), x, 1e-5f);
          EXPECT_NEAR(projected(1) / projected(3), y, 1e-5f);
        }
      }
    }
  }
}

TEST(Camera, APartOfTheFrameIsSeenByTheCameraThatFitsTheWhole) {
  scene::Scene scene;  // without a camera
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-2, -1, 0}, {4, 0, 0}, {0, 1, 1}, 0));
  RenderSettings settings = SettingsOf(24, 18);
  settings.lens = {2, 3};
  const PictureCamera whole = *MakeCamera(scene, settings);
  settings.width = 9;
  settings.height = 4;
  settings.frame = {24, 18, 11, 5};
  const PictureCamera part = *MakeCamera(scene, settings);
  const scene::Vec2 u = {0.3f, 0.8f};
  for (const auto& [x, y] : {std::pair{0, 0}, {8, 0}, {0, 3}, {8, 3}}) {
    const scene::Vec2 point = part.PointIn(x, y, u);
    EXPECT_EQ(point.x, whole.PointIn(x + 11, y + 5, u).x);
    EXPECT_EQ(point.y, whole.PointIn(x + 11, y + 5, u).y);
    EXPECT_EQ(part.NumberOf(x, y), whole.NumberOf(x + 11, y + 5));
    const Ray of_part = part.RayThrough(point.x, point.y, u);
    const Ray of_whole = whole.RayThrough(point.x, point.y, u);
    EXPECT_EQ(of_part.origin, of_whole.origin);
    EXPECT_EQ(of_part.direction, of_whole.direction);
  }
  EXPECT_EQ(part.WorldToNdc(), whole.WorldToNdc());
}

TEST(Camera, RaysOfOnePicturePointMeetInThePlaneOfFocus) {
  const PictureCamera camera(Forward(), {1.4f, 2.5f}, {40, 30});
  const PictureCamera pinhole(Forward(), {}, {40, 30});
  const Ray central = pinhole.RayThrough(31, 4, {});
  const Vec3 sharp = central.direction * (2.5f / -central.direction.z);
  double widest = 0;
  for (int i = 0; i < 64; ++i) {
    const int row = i / 8;
    const Ray ray = camera.RayThrough(
        31, 4, {(static_cast<float>(i % 8) + 0.5f) / 8, (static_cast<float>(row) + 0.5f) / 8});
    EXPECT_EQ(ray.origin.z, 0);
    widest = std::max(widest, static_cast<double>(Length(ray.origin)));
    const Vec3 met = ray.origin + ray.direction * (2.5f / -ray.direction.z);
    EXPECT_NEAR(Length(met - sharp), 0, 1e-5);
  }
  EXPECT_LE(widest, LensRadius(1.4));
  EXPECT_GT(widest, 0.85 * LensRadius(1.4));
}

TEST(Camera, APointOutOfFocusBecomesADiskOfTheExpectedSize) {
  constexpr int kSize = 32;
  constexpr Rect kMiddle = {10, 10, 22, 22};
  constexpr float kDistance = 4;
  constexpr float kFocus = 1.5f;
  scene::Scene scene;
  scene.materials = {testing::Emitter({1000, 1000, 1000})};
  const float side = 0.04f;
  testing::Place(&scene,
                 testing::QuadMesh({-side / 2, -side / 2, -kDistance}, {side, 0, 0}, {0, side, 0}, 0));
  scene.cameras = {Forward()};
  RenderSettings settings = SettingsOf(kSize, kSize);
  settings.lens = {0.25f, kFocus};
  const auto renderer = MakeRenderer(scene, settings);
  RenderCounts counts;
  const LayeredImage image = renderer->RenderPass(kMiddle, 0, {0, 4096}, &counts).pixels;
  const ConstFloatView light_a = image.GetColor(layers::HalfA(layers::kEmission))[0];
  const ConstFloatView light_b = image.GetColor(layers::HalfB(layers::kEmission))[0];
  double total = 0;
  double moment = 0;
  for (int y = 0; y < kMiddle.height(); ++y) {
    for (int x = 0; x < kMiddle.width(); ++x) {
      const double dx = x + kMiddle.x0 + 0.5 - kSize / 2.0;
      const double dy = y + kMiddle.y0 + 0.5 - kSize / 2.0;
      const auto light = static_cast<double>(light_a.At(x, y) + light_b.At(x, y));
      total += light;
      moment += light * (dx * dx + dy * dy);
    }
  }
  ASSERT_GT(total, 0);
  const double pixel = 2 * std::tan(static_cast<double>(kYfov) / 2) / kSize;  // at distance 1
  const double radius = LensRadius(0.25) *
                        std::abs(1 / static_cast<double>(kDistance) - 1 / static_cast<double>(kFocus)) /
                        pixel;
  // The second moment of a uniform disk is half its squared radius. Pixel and light are squares; each adds a
  // sixth of its squared side.
  const double light_pixels = static_cast<double>(side) / static_cast<double>(kDistance) / pixel;
  EXPECT_NEAR(std::sqrt(2 * (moment / total - (1 + light_pixels * light_pixels) / 6)), radius, 0.03 * radius);
}

TEST(Camera, GeometryIsSeenThroughTheLens) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({0, -9, -4}, {9, 0, 0}, {0, 18, 0}, 0));  // the right half
  scene.cameras = {Forward()};
  const auto edge_width = [&](float focus) {
    RenderSettings settings = SettingsOf(32, 32);
    settings.lens = {0.1f, focus};
    const LayeredImage geometry = MakeRenderer(scene, settings)->RenderGeometry({0, 16, 32, 17}, 0).pixels;
    int partial = 0;
    for (int x = 0; x < 32; ++x) {
      const float alpha = geometry.Get(layers::kAlpha).At(x, 0);
      partial += alpha > 0 && alpha < 1;
    }
    return partial;
  };
  EXPECT_LE(edge_width(4), 1);
  EXPECT_GE(edge_width(2), 4);
}

TEST(Camera, ThePictureTellsHowFarEachPixelIsBlurred) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({0, -9, -4}, {9, 0, 0}, {0, 18, 0}, 0));  // the right half
  scene.cameras = {Forward()};
  RenderSettings settings = SettingsOf(32, 32);
  settings.lens = {2, 3};
  const LayeredImage geometry = MakeRenderer(scene, settings)->RenderGeometry({0, 16, 32, 17}, 0).pixels;
  const ConstFloatView blur = geometry.Get(layers::kBlur);
  const double pixel = 2 * std::tan(static_cast<double>(kYfov) / 2) / 32;  // at distance 1
  const double of_far = 2 * LensRadius(2) / 3 / pixel;
  EXPECT_NEAR(static_cast<double>(blur.At(2, 0)), of_far, 1e-3 * of_far) << "nothing is hit";
  EXPECT_NEAR(static_cast<double>(blur.At(29, 0)), of_far / 4, 1e-3 * of_far) << "at 4 m";
  settings.lens = {};
  EXPECT_FALSE(MakeRenderer(scene, settings)->RenderGeometry({0, 16, 32, 17}, 0).pixels.Has(layers::kBlur));
}

TEST(Camera, ALensNeedsAFocusAndAPerspectiveCamera) {
  scene::Scene scene;
  scene.cameras = {Forward()};
  RenderSettings settings = SettingsOf(8, 8);
  settings.lens = {2, 0};
  EXPECT_THAT(
      std::string(Renderer::Create(std::make_shared<scene::Scene>(scene), settings).status().message()),
      HasSubstr("focus"));
  settings.lens = {-1, 1};
  EXPECT_THAT(
      std::string(Renderer::Create(std::make_shared<scene::Scene>(scene), settings).status().message()),
      HasSubstr("f-stop"));
  scene.cameras[0].kind = scene::Camera::Kind::kOrthographic;
  scene.cameras[0].name = "plan";
  settings.lens = {2, 1};
  EXPECT_THAT(
      std::string(Renderer::Create(std::make_shared<scene::Scene>(scene), settings).status().message()),
      HasSubstr("'plan' is orthographic"));
}

}  // namespace
}  // namespace lumifold::render
