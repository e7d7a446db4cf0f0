// Every ray has the time of the camera ray whose path it belongs to.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "tests/bench/embree_tap.h"
#include "tests/charts/access/charts_access.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/sampling/sampler.h"

namespace lumifold::render {
namespace {

/// A room with smooth glass, a mirror, and surfaces that have lanes and surfaces that have not.
scene::Scene RoomOfAllKinds() {
  scene::Scene room = testing::SmallRoom();
  room.materials[1].specular.factor = 1;
  room.materials[1].base.roughness = 0.4f;
  room.materials[2].transmission.factor = 1;
  room.materials[2].base.roughness = 0;
  room.materials[2].volume.is_solid = true;  // shadow rays do not pass it
  return room;
}

TEST(RayTime, AllRaysOfAPathHaveTheTimeOfItsCameraRay) {
  const auto renderer = MakeRenderer(RoomOfAllKinds(), SettingsOf(8, 8));
  for (const auto shading : {ChartsAccess::Shading::kInLanes, ChartsAccess::Shading::kAlone}) {
    ChartsAccess::SetShading(shading, renderer.get());
    const ChartsAccess access(*renderer);
    bench::RayLog log;
    const bench::ScopedRayLog listening(&log);
    size_t camera_rays = 0;
    for (uint32_t pixel = 0; pixel < 64; ++pixel) {
      std::vector<Ray> rays;
      std::vector<Sampler> samplers;
      for (uint32_t sample = 0; sample < PathTracer::kPacket; ++sample) {
        samplers.emplace_back(1, 0, pixel, sample);
        const uint32_t column = pixel % 8;
        const uint32_t row = pixel / 8;
        rays.push_back(access.camera().RayThrough(0.5f + static_cast<float>(column),
                                                  0.5f + static_cast<float>(row), {}));
        rays.back().random_key = samplers.back().Key(kCameraPair);
        rays.back().time = 0.25f;
      }
      std::vector<LayerSample> samples(rays.size());
      access.Trace(rays, samplers, samples);
      camera_rays += rays.size();
    }
    EXPECT_GT(log.rays.size(), 3 * camera_rays);
    for (const bench::TracedRay& ray : log.rays) {
      ASSERT_EQ(ray.time, 0.25f);
      ASSERT_EQ(ray.near_distance, 0);
    }
  }
}

}  // namespace
}  // namespace lumifold::render
