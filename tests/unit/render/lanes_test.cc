// Paths that are shaded side by side have the bits that each has alone, whatever the vectors' width, the
// stream and the materials beside them.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "tests/charts/access/charts_access.h"
#include "tests/support/analytic_scenes.h"
#include "tests/unit/render/pictures.h"
#include "worker/render/lanes/pick_lanes.h"
#include "worker/render/lanes/vertex_lanes.h"
#include "worker/render/sampling/sampler.h"

namespace lumifold::render {
namespace {

/// Calls visit() with each instruction set of this machine in turn.
template <typename Visit>
void ForEachInstructionSet(Visit visit) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(hwy::TargetName(target));
    visit();
  }
  hwy::SetSupportedTargetsForTest(0);
}

/// A room of which some surfaces have lanes and others have not.
scene::Scene MixedRoom() {
  scene::Scene room = testing::SmallRoom();
  room.materials[1].base.roughness = 0.4f;
  room.materials[1].specular.factor = 1;
  room.materials[2].base.metallic = 0.7f;
  room.materials[2].base.roughness = 0.5f;
  room.materials[2].specular.factor = 1;
  return room;
}

void ExpectSamePlanes(const LayeredImage& a, const LayeredImage& b) {
  ASSERT_EQ(a.channels().size(), b.channels().size());
  for (const LayeredImage::Channel& channel : a.channels()) {
    for (int y = 0; y < a.height(); ++y) {
      for (int x = 0; x < a.width(); ++x) {
        ASSERT_EQ(std::bit_cast<uint32_t>(channel.plane.At(x, y)),
                  std::bit_cast<uint32_t>(b.Get(channel.name).At(x, y)))
            << channel.name << " at " << x << ", " << y;
      }
    }
  }
}

LayeredImage PassOf(const Renderer& renderer) {
  RenderCounts counts;
  return renderer.RenderPass({0, 0, 24, 18}, 0, SampleRange{3, 15}, &counts).pixels;
}

TEST(Lanes, APassHasTheBitsOfPathsThatAreTracedAlone) {
  for (const scene::Scene& room : {testing::SmallRoom(), MixedRoom()}) {
    const auto renderer = MakeRenderer(room, SettingsOf(24, 18));
    ChartsAccess::SetShading(ChartsAccess::Shading::kAlone, renderer.get());
    const LayeredImage alone = PassOf(*renderer);
    ChartsAccess::SetShading(ChartsAccess::Shading::kInLanes, renderer.get());
    ForEachInstructionSet([&] { ExpectSamePlanes(PassOf(*renderer), alone); });
  }
}

TEST(Lanes, APassIsIndependentOfTheStream) {
  const auto renderer = MakeRenderer(MixedRoom(), SettingsOf(24, 18));
  const LayeredImage expected = PassOf(*renderer);
  for (const size_t packets : {1, 2, 3, 7, 64, 512}) {
    ChartsAccess::SetStreamPackets(packets, renderer.get());
    ExpectSamePlanes(PassOf(*renderer), expected);
  }
}

bool IsSame(Vec2 a, Vec2 b) { return a.x == b.x && a.y == b.y; }

TEST(Lanes, PickTheLightThatTheTreePicks) {
  const auto number = [](uint32_t of, uint32_t what) {
    return static_cast<float>(Sampler(7, 0, int64_t{of}, 0).Get2D(what).x);
  };
  const auto vector = [&](uint32_t of, uint32_t what) {
    return Vec3{number(of, what), number(of, what + 1), number(of, what + 2)} * 4 - Vec3{2, 2, 2};
  };
  for (const uint32_t count : {1u, 2u, 7u, 16u}) {
    std::vector<EmitterBounds> emitters(count);
    for (uint32_t i = 0; i < count; ++i) {
      const Vec3 corner = vector(i, 0);
      emitters[i] = {.box = {corner, corner + Vec3{1, 0, 1}}, .axis = Normalize(vector(i, 3))};
      emitters[i].both_sides = i % 3 == 0;
      emitters[i].intensity = static_cast<double>(1 + i);
    }
    const LightTree tree(emitters);
    ASSERT_NE(tree.OnlyLeaf(), nullptr);
    std::array<SurfaceRecord, kMaxLanes> surfaces;
    VertexLanes lanes;
    for (uint32_t i = 0; i < kMaxLanes; ++i) {
      surfaces[i].position = vector(100 + i, 0);
      surfaces[i].normal = Normalize(vector(100 + i, 3));
      lanes.vertices[i].surface = &surfaces[i];
      lanes.random.light_and_lobe.x[i] = 0.25f * number(100 + i, 6);
    }
    ForEachInstructionSet([&] {
      PickLanes(*tree.OnlyLeaf(), 0.25f, kMaxLanes, &lanes);
      for (size_t i = 0; i < kMaxLanes; ++i) {
        const LightTree::Choice alone = tree.Pick({surfaces[i].position, surfaces[i].normal, false},
                                                  lanes.random.light_and_lobe.x[i] / 0.25f);
        EXPECT_EQ(lanes.choice.probability[i], alone.probability) << i;
        if (alone.probability <= 0) continue;
        EXPECT_EQ(tree.OnlyLeaf()->emitters[static_cast<size_t>(lanes.choice.slot[i])], alone.emitter) << i;
      }
    });
  }
}

TEST(Lanes, NumbersAreThoseOfTheSampler) {
  std::vector<Sampler> samplers;
  for (uint32_t i = 0; i < kMaxLanes; ++i) samplers.emplace_back(7, 3, 1000 + i / 5, i);
  ForEachInstructionSet([&] {
    for (size_t count = 1; count <= kMaxLanes; ++count) {
      RandomLanes random = {};
      for (size_t i = 0; i < count; ++i) PathSampler(samplers[i]).SetLane(5, i, &random);
      random.Draw(count);
      for (size_t i = 0; i < count; ++i) {
        const VertexNumbers expected = PathSampler(samplers[i]).Draw(5);
        EXPECT_TRUE(IsSame(random.light_and_lobe.At(i), expected.light_and_lobe)) << i;
        EXPECT_TRUE(IsSame(random.light_point.At(i), expected.light_point)) << i;
        EXPECT_TRUE(IsSame(random.direction.At(i), expected.direction)) << i;
      }
    }
  });
}

}  // namespace
}  // namespace lumifold::render
