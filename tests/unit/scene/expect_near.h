#pragma once

#include <gtest/gtest.h>

#include "worker/scene/vec.h"

namespace lumifold::scene {

inline void ExpectNear(Vec3 actual, Vec3 expected) {
  EXPECT_NEAR(actual.x, expected.x, 1e-6);
  EXPECT_NEAR(actual.y, expected.y, 1e-6);
  EXPECT_NEAR(actual.z, expected.z, 1e-6);
}

}  // namespace lumifold::scene
