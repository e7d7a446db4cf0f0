#include "worker/render/lights/light_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace lumifold::render {
namespace {

using scene::Vec3;

float Between(std::mt19937& random, float low, float high) {
  return low + (high - low) * static_cast<float>(random() >> 8) * 0x1p-24f;
}

Vec3 RandomUnit(std::mt19937& random) {
  while (true) {
    const Vec3 v = {Between(random, -1, 1), Between(random, -1, 1), Between(random, -1, 1)};
    if (LengthSquared(v) > 0.01f && LengthSquared(v) < 1) return Normalize(v);
  }
}

std::vector<EmitterBounds> RandomEmitters(int count) {
  std::mt19937 random(11);
  std::vector<EmitterBounds> emitters(count);
  for (EmitterBounds& e : emitters) {
    const Vec3 p = {Between(random, -5, 5), Between(random, -5, 5), Between(random, -5, 5)};
    e.box = {p, p + Vec3{Between(random, 0, 0.5f), Between(random, 0, 0.5f), Between(random, 0, 0.5f)}};
    e.axis = RandomUnit(random);
    e.both_sides = random() % 4 == 0;
    if (random() % 4 == 0) e.spread = 3.1415927f;
    e.intensity = static_cast<double>(Between(random, 0.1f, 10));
  }
  return emitters;
}

LightReceiver RandomReceiver(std::mt19937& random) {
  return {{Between(random, -6, 6), Between(random, -6, 6), Between(random, -6, 6)}, RandomUnit(random)};
}

TEST(LightTree, ProbabilitiesSumToTheFractionOfSuccessfulPicks) {
  const std::vector<EmitterBounds> emitters = RandomEmitters(300);
  const LightTree tree(emitters);
  std::mt19937 random(5);
  constexpr int kPicks = 4096;
  for (int i = 0; i < 100; ++i) {
    const LightReceiver receiver = RandomReceiver(random);
    double sum = 0;
    for (uint32_t e = 0; e < emitters.size(); ++e) sum += static_cast<double>(tree.Probability(receiver, e));
    int found = 0;
    for (int k = 0; k < kPicks; ++k)
      found += tree.Pick(receiver, (static_cast<float>(k) + 0.5f) / kPicks).probability > 0;
    EXPECT_NEAR(sum, static_cast<double>(found) / kPicks, 2e-3);
    EXPECT_LE(sum, 1.0001);
    EXPECT_GT(sum, 0.9);
  }
}

TEST(LightTree, ProbabilitiesSumToOneForIsotropicEmitters) {
  std::vector<EmitterBounds> emitters = RandomEmitters(300);
  for (EmitterBounds& e : emitters) e.spread = 3.1415927f;
  const LightTree tree(emitters);
  std::mt19937 random(5);
  for (int i = 0; i < 100; ++i) {
    const LightReceiver receiver = RandomReceiver(random);
    double sum = 0;
    for (uint32_t e = 0; e < emitters.size(); ++e) sum += static_cast<double>(tree.Probability(receiver, e));
    EXPECT_NEAR(sum, 1, 1e-4);
  }
}

TEST(LightTree, PickFollowsItsProbability) {
  for (const int count : {1, 2, 15, 16, 17, 100}) {  // leaves hold up to 16
    const std::vector<EmitterBounds> emitters = RandomEmitters(count);
    const LightTree tree(emitters);
    std::mt19937 random(6);
    const LightReceiver receiver = RandomReceiver(random);
    constexpr int kPicks = 1 << 16;
    std::vector<double> picked(emitters.size());
    for (int i = 0; i < kPicks; ++i) {
      const LightTree::Choice choice = tree.Pick(receiver, (static_cast<float>(i) + 0.5f) / kPicks);
      if (choice.probability <= 0) continue;
      ASSERT_EQ(choice.probability, tree.Probability(receiver, choice.emitter));
      picked[choice.emitter] += 1.0 / kPicks;
    }
    for (uint32_t e = 0; e < emitters.size(); ++e)
      EXPECT_NEAR(picked[e], static_cast<double>(tree.Probability(receiver, e)), 1e-4) << count << " " << e;
  }
}

TEST(LightTree, LightsFromBelowCountWhereTheReceiverTransmits) {
  std::vector<EmitterBounds> emitters(2);
  emitters[0].box = {{0, 2, 0}, {0, 2, 0}};
  emitters[1].box = {{0, -2, 0}, {0, -2, 0}};
  for (EmitterBounds& e : emitters) {
    e.spread = 3.1415927f;
    e.intensity = 1;
  }
  const LightTree tree(emitters);
  const LightReceiver opaque = {{0, 0, 0}, {0, 1, 0}, /*transmits=*/false};
  EXPECT_EQ(tree.Probability(opaque, 0), 1);
  EXPECT_EQ(tree.Probability(opaque, 1), 0);
  const LightReceiver leaf = {{0, 0, 0}, {0, 1, 0}, /*transmits=*/true};
  EXPECT_EQ(tree.Probability(leaf, 0), 0.5f);
  EXPECT_EQ(tree.Probability(leaf, 1), 0.5f);
}

TEST(LightTree, TreatsAllAxesAndBothDirectionsAlike) {
  const std::vector<EmitterBounds> emitters = RandomEmitters(40);
  std::mt19937 random(9);
  std::vector<LightReceiver> receivers;
  for (int i = 0; i < 20; ++i) receivers.push_back(RandomReceiver(random));
  const LightTree tree(emitters);
  for (int turn = 0; turn < 3; ++turn) {
    for (const float sign : {1.0f, -1.0f}) {
      const auto turned = [&](Vec3 v) { return Vec3{v[turn], v[(turn + 1) % 3], v[(turn + 2) % 3]} * sign; };
      std::vector<EmitterBounds> moved = emitters;
      for (EmitterBounds& e : moved) {
        const Vec3 ends[] = {turned(e.box.min), turned(e.box.max)};
        e.box = sign > 0 ? scene::Bounds{ends[0], ends[1]} : scene::Bounds{ends[1], ends[0]};
        e.axis = turned(e.axis);
      }
      const LightTree other(moved);
      for (const LightReceiver& receiver : receivers) {
        for (uint32_t e = 0; e < emitters.size(); ++e) {
          EXPECT_NEAR(other.Probability({turned(receiver.position), turned(receiver.normal)}, e),
                      tree.Probability(receiver, e), 1e-4)
              << turn << " " << sign << " " << e;
        }
      }
    }
  }
}

TEST(LightTree, PrefersNearAndFacingEmitters) {
  std::vector<EmitterBounds> emitters(3);
  const Vec3 places[] = {{0, 2, 0}, {0, 2.1f, 0.2f}, {0, 20, 0}};
  for (int i = 0; i < 3; ++i) {
    emitters[i].box = {places[i], places[i]};
    emitters[i].axis = {0, i == 1 ? 1.0f : -1.0f, 0};
    emitters[i].intensity = 1;
  }
  const LightTree tree(emitters);
  const LightReceiver floor = {{0, 0, 0}, {0, 1, 0}};
  EXPECT_GT(tree.Probability(floor, 0), 0.9f);
  EXPECT_LT(tree.Probability(floor, 1), 1e-3f);  // it emits away from the floor
  EXPECT_GT(tree.Probability(floor, 2), 0);
}

TEST(LightTree, EveryContributingEmitterHasAProbability) {
  const std::vector<EmitterBounds> emitters = RandomEmitters(150);
  const LightTree tree(emitters);
  std::mt19937 random(8);
  for (int i = 0; i < 200; ++i) {
    const LightReceiver receiver = RandomReceiver(random);
    for (uint32_t e = 0; e < emitters.size(); ++e) {
      const Vec3 to_light = emitters[e].box.max - receiver.position;
      const float facing = -Dot(Normalize(to_light), emitters[e].axis);
      const bool shines = facing > 1e-3f || emitters[e].both_sides || emitters[e].spread > 3;
      if (shines && std::abs(Dot(Normalize(to_light), receiver.normal)) > 1e-3f) {
        EXPECT_GT(tree.Probability(receiver, e), 0) << e;
      }
    }
  }
}

TEST(LightTree, AcceptsCoincidentEmittersAndEmittersWithoutIntensity) {
  std::vector<EmitterBounds> emitters(200);
  for (EmitterBounds& e : emitters) {
    e.box = {{1, 1, 1}, {1, 1, 1}};
    e.spread = 3.1415927f;
    e.intensity = 1;
  }
  emitters[7].intensity = 0;
  const LightTree tree(emitters);
  const LightReceiver receiver = {{0, 0, 0}, {0, 1, 0}};
  EXPECT_EQ(tree.Probability(receiver, 7), 0);
  EXPECT_NEAR(tree.Probability(receiver, 8), 1.0 / 199, 2e-3);
  EXPECT_TRUE(LightTree(std::vector<EmitterBounds>(3)).IsEmpty());
  EXPECT_EQ(LightTree(std::vector<EmitterBounds>(3)).Pick(receiver, 0.5f).probability, 0);
}

}  // namespace
}  // namespace lumifold::render
