// The functions of ChartsAccess for methods that estimate indirect light themselves.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <optional>

#include "filter/image/portable_math.h"
#include "tests/charts/access/charts_access.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/sampling/frame.h"

namespace lumifold::render {
namespace {

constexpr int kChartWidth = 24;
constexpr int kChartHeight = 18;

TEST(TraceWithoutIndirect, ChangesIndirectLightOnly) {
  const std::unique_ptr<Renderer> renderer =
      MakeRenderer(testing::SmallRoom(), SettingsOf(kChartWidth, kChartHeight, 4));
  const ChartsAccess access(*renderer);
  std::array<LayerSample, PathTracer::kPacket> whole;
  std::array<LayerSample, PathTracer::kPacket> without;
  std::array<std::optional<Surface>, PathTracer::kPacket> diffuse;
  int with_indirect = 0;
  for (int y = 0; y < kChartHeight; ++y) {
    for (int x = 0; x < kChartWidth; ++x) {
      ForEachCameraPacket(access.camera(), 0, 0, x, y, {0, 11}, [&](const CameraPacket& packet) {
        access.Trace(packet.rays(), packet.samplers(), whole);
        access.TraceWithoutIndirect(packet.rays(), packet.samplers(), without, diffuse);
        for (size_t i = 0; i < packet.size(); ++i) {
          EXPECT_EQ(whole[i].direct, without[i].direct);
          EXPECT_EQ(whole[i].albedo, without[i].albedo);
          EXPECT_EQ(whole[i].emitted, without[i].emitted);
          EXPECT_EQ(whole[i].glossy, without[i].glossy);
          EXPECT_EQ(whole[i].remainder, without[i].remainder);
          EXPECT_EQ(without[i].indirect, Vec3{});
          const Vec3 expected = whole[i].combined - whole[i].indirect * whole[i].albedo;
          EXPECT_LT(Length(without[i].combined - expected), 1e-5f * (1 + Length(whole[i].combined)));
          EXPECT_TRUE(diffuse[i].has_value() || whole[i].indirect == Vec3{});
          with_indirect += whole[i].indirect == Vec3{} ? 0 : 1;
        }
      });
    }
  }
  EXPECT_GT(with_indirect, 1000);
}

TEST(TraceIndirect, AveragesToIndirectLightOverCosineDistributedDirections) {
  scene::Scene scene = testing::SmallRoom();
  scene.cameras = {testing::LookAt({0, 0, 1.9f}, {0.6f, 0.7f, -2}, 1e-3f)};
  const std::unique_ptr<Renderer> renderer = MakeRenderer(scene, SettingsOf(1, 1, 4));
  const ChartsAccess access(*renderer);
  constexpr uint32_t kSamples = 16384;
  std::array<LayerSample, PathTracer::kPacket> samples;
  Vec3 expected;
  ForEachCameraPacket(access.camera(), 0, 0, 0, 0, {0, kSamples}, [&](const CameraPacket& packet) {
    access.Trace(packet.rays(), packet.samplers(), samples);
    for (size_t i = 0; i < packet.size(); ++i) expected += samples[i].indirect / kSamples;
  });
  const Ray ray = access.camera().RayThrough(0.5f, 0.5f, {});
  const std::optional<Surface> wall = access.FirstDiffuseSurface(ray);
  ASSERT_TRUE(wall.has_value());
  Vec3 mean;
  for (uint32_t i = 0; i < kSamples; ++i) {
    const Sampler sampler(1, 0, 0, i);
    const Vec2 disk = ConcentricDisk(sampler.Get2D(kCameraPair));
    const float height = std::sqrt(std::max(0.0f, 1 - disk.x * disk.x - disk.y * disk.y));
    const IndirectRadiance incident =
        access.TraceIndirect(*wall, Frame::Of(wall->normal).ToWorld({disk.x, disk.y, height}), sampler);
    EXPECT_GT(incident.distance, 0);
    EXPECT_LT(incident.distance, 7);
    mean += incident.radiance / kSamples;
  }
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean[c] / expected[c], 1, 0.03) << c;
}

TEST(TraceIndirect, IsBlackAndInfinitelyFarOnAMiss) {
  scene::Scene scene;
  scene.materials = {testing::Lambert({0.5f, 0.5f, 0.5f})};
  testing::Place(&scene, testing::QuadMesh({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 2}, {0, 0, 0}, 0.5f)};
  const std::unique_ptr<Renderer> renderer = MakeRenderer(scene, SettingsOf(1, 1));
  const ChartsAccess access(*renderer);
  const std::optional<Surface> quad = access.FirstDiffuseSurface(access.camera().RayThrough(0.5f, 0.5f, {}));
  ASSERT_TRUE(quad.has_value());
  const IndirectRadiance incident = access.TraceIndirect(*quad, {0, 0, 1}, Sampler(0, 0, 0, 0));
  EXPECT_EQ(incident.radiance, Vec3{});
  EXPECT_TRUE(std::isinf(incident.distance));
}

TEST(FirstDiffuseSurface, IsEmptyOnMirrorsAndOnAMiss) {
  scene::Scene scene;
  scene::Material mirror;
  mirror.base.roughness = 0;
  scene.materials = {mirror};
  testing::Place(&scene, testing::QuadMesh({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 0));
  scene.cameras = {testing::LookAt({0, 0, 2}, {0, 0, 0}, 2.5f)};
  const std::unique_ptr<Renderer> renderer = MakeRenderer(scene, SettingsOf(9, 9));
  const ChartsAccess access(*renderer);
  EXPECT_FALSE(access.FirstDiffuseSurface(access.camera().RayThrough(4.5f, 4.5f, {})));
  EXPECT_FALSE(access.FirstDiffuseSurface(access.camera().RayThrough(0.5f, 0.5f, {})));
}

}  // namespace
}  // namespace lumifold::render
