#pragma once

#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "tests/support/gltf_fixture.h"

/// Loads documents that must be valid or must be refused.
namespace lumifold::scene {

inline GltfFixture OneTriangle() {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  return fixture;
}

/// The document's scene at a time; fails the test if it does not load.
inline Scene At(double time_seconds, const GltfFixture& fixture) {
  LoadOptions options;
  options.time_seconds = time_seconds;
  auto scene = fixture.Load(options);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? *std::move(scene) : Scene{};
}

inline Scene MustLoad(const GltfFixture& fixture) { return At(LoadOptions{}.time_seconds, fixture); }

/// The error of a document that must not load; fails the test if it loads.
inline std::string ErrorOf(const GltfFixture& fixture) {
  const auto scene = fixture.Load();
  EXPECT_FALSE(scene.ok());
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(scene.status().message());
}

}  // namespace lumifold::scene
