#include "worker/scene/transforms.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/scene/expect_near.h"

namespace lumifold::scene {
namespace {

TEST(Transforms, ScaleThenRotateThenTranslate) {
  const float half = std::sqrt(0.5f);
  const Affine a = *AffineFromTrs({10, 20, 30}, {0, 0, half, half}, {2, 3, 4});  // a quarter turn about z
  ExpectNear(a.Point({1, 0, 0}), {10, 22, 30});
  ExpectNear(a.Point({0, 1, 0}), {7, 20, 30});
  ExpectNear(a.Point({0, 0, 1}), {10, 20, 34});
}

TEST(Transforms, AcceptQuaternionsOfAnyLength) {
  ExpectNear(AffineFromTrs({}, {0, 0, 5, 5}, {1, 1, 1})->Vector({1, 0, 0}), {0, 1, 0});
  EXPECT_FALSE(AffineFromTrs({}, {0, 0, 0, 0}, {1, 1, 1}).ok());
}

TEST(Transforms, ReadMatricesColumnByColumn) {
  tinygltf::Node node;
  node.matrix = {1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 10, 0, 11, 12, 13, 1};
  const Affine a = *LocalTransform(node);
  EXPECT_EQ(a.x, (Vec3{1, 2, 3}));
  EXPECT_EQ(a.z, (Vec3{7, 8, 10}));
  EXPECT_EQ(a.origin, (Vec3{11, 12, 13}));
}

TEST(Transforms, KeepOriginAndDirectionsInTheRigidPart) {
  // Scaled, sheared and mirrored.
  const Affine rigid = RigidPart({{-3, 0, 0}, {0, 2, 0.5f}, {0, 0, 1e20f}, {1, 2, 3}});
  ExpectNear(rigid.x, {1, 0, 0});
  ExpectNear(rigid.y, {0, 1, 0});
  ExpectNear(rigid.z, {0, 0, 1});
  EXPECT_EQ(rigid.origin, (Vec3{1, 2, 3}));
}

TEST(Transforms, AreInvertibleOnlyWithAUsableDeterminant) {
  EXPECT_TRUE(IsInvertible(Affine{}));
  EXPECT_TRUE(IsInvertible(Affine{{-1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {}}));
  EXPECT_FALSE(IsInvertible(Affine{{1, 0, 0}, {0, 0, 0}, {0, 0, 1}, {}}));
  EXPECT_FALSE(IsInvertible(Affine{{1e-20f, 0, 0}, {0, 1e-20f, 0}, {0, 0, 1e-20f}, {}}));
  EXPECT_FALSE(IsInvertible(Affine{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {INFINITY, 0, 0}}));
}

}  // namespace
}  // namespace lumifold::scene
