#include "client/scene/camera_aspect.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

// Three cameras in another order than their nodes; the walk begins at node 2, whose child is node 0.
constexpr char kScene[] = R"({
  "asset": {"version": "2.0"}, "scene": 1,
  "scenes": [{"nodes": [3]}, {"nodes": [2, 1]}],
  "nodes": [{"camera": 1}, {"camera": 2, "name": "plan"}, {"name": "root", "children": [0]}, {"camera": 0}],
  "cameras": [
    {"type": "perspective", "perspective": {"yfov": 1, "aspectRatio": 9}},
    {"type": "perspective", "perspective": {"yfov": 1, "aspectRatio": 1.5}},
    {"type": "orthographic", "orthographic": {"xmag": 4, "ymag": 2}}]})";

TEST(CameraAspect, IsThatOfTheCameraThatAWorkerTakes) {
  EXPECT_EQ(CameraAspectOf(kScene, ""), 1.5);
  EXPECT_EQ(CameraAspectOf(kScene, "camera1"), 1.5);
  EXPECT_EQ(CameraAspectOf(kScene, "plan"), 2);
  EXPECT_EQ(CameraAspectOf(kScene, "1"), 2);
}

TEST(CameraAspect, IsNothingWhereNobodySays) {
  EXPECT_EQ(CameraAspectOf(kScene, "2"), std::nullopt);
  EXPECT_EQ(CameraAspectOf(kScene, "nobody"), std::nullopt);
  for (const char* text :
       {"", "no JSON", "[]", R"({"nodes": 3})", R"({"nodes": [{"camera": 7}]})",
        R"({"nodes": [{"camera": 0}], "cameras": [{"perspective": {"yfov": 1}}]})",
        R"({"nodes": [{"camera": 0}], "cameras": [{"perspective": {"aspectRatio": -1}}]})",
        R"({"nodes": [{"camera": 0}], "cameras": [{"orthographic": {"xmag": 1, "ymag": 0}}]})",
        R"({"nodes": [{"camera": 0}], "cameras": [{"orthographic": []}]})",
        R"({"scenes": [{"nodes": [0]}], "nodes": [{"children": [1]}, {"children": [0, "1", -1, 9]}]})"}) {
    EXPECT_EQ(CameraAspectOf(text, ""), std::nullopt) << text;
  }
}

}  // namespace
}  // namespace lumifold::client
