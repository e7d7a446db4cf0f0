#include "worker/scene/nodes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/gltf_fixture.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// A document with mesh 0 in node 0.
GltfFixture TriangleOfOneNode() {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  return fixture;
}

std::vector<Vec3> Origins(const Scene& scene) {
  std::vector<Vec3> origins;
  origins.reserve(scene.instances.size());
  for (const Instance& instance : scene.instances) origins.push_back(instance.world_from_object.origin);
  return origins;
}

TEST(Nodes, ComposeTransformsFromTheRoot) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.json["nodes"][0]["translation"] = {1, 0, 0};
  fixture.json["nodes"][0]["name"] = "leaf";
  fixture.AddNode({{"children", {0}}, {"scale", {2, 2, 2}}, {"translation", {0, 5, 0}}});
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.instances.size(), 1u);
  EXPECT_EQ(scene.instances[0].name, "leaf");
  EXPECT_EQ(scene.instances[0].world_from_object.origin, (Vec3{2, 5, 0}));
  EXPECT_EQ(scene.instances[0].world_from_object.x, (Vec3{2, 0, 0}));
}

TEST(Nodes, ShareAMeshAmongInstances) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.AddNode({{"mesh", 0}, {"translation", {3, 0, 0}}});
  const Scene scene = MustLoad(fixture);
  EXPECT_EQ(scene.meshes.size(), 1u);
  EXPECT_THAT(Origins(scene), ElementsAre(Vec3{0, 0, 0}, Vec3{3, 0, 0}));
}

TEST(Nodes, CatchShadowsWhereTheirPropertySaysSo) {
  GltfFixture fixture = TriangleOfOneNode();
  const auto load = [&](const json& value, bool catches) {
    fixture.json["nodes"][0]["extras"] = {{kShadowCatcher, value}, {"other", "text"}};
    LoadOptions options;
    options.catches_shadows = catches;
    return *LoadGltf(fixture.Glb(), "f.glb", nullptr, options);
  };
  for (const json& value : {json(true), json(1)}) {
    const Scene scene = load(value, true);
    EXPECT_THAT(scene.instances, IsEmpty());
    ASSERT_EQ(scene.catchers.size(), 1u);
    EXPECT_EQ(scene.catchers[0].mesh, 0);
  }
  for (const json& value : {json(false), json(0), json(), json("yes")})
    EXPECT_THAT(load(value, true).catchers, IsEmpty()) << value;
  const Scene opaque = load(true, false);
  EXPECT_EQ(opaque.instances.size(), 1u);
  EXPECT_THAT(opaque.warnings, Contains(HasSubstr("shadow catchers shown like other surfaces")));
}

TEST(Nodes, DoNotReadMeshesThatNoNodePlaces) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.AddMesh({{"attributes", {{"POSITION", 99}}}});
  EXPECT_EQ(MustLoad(fixture).meshes.size(), 1u);
}

TEST(Nodes, ShowTheDefaultSceneElseTheFirst) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.AddNode({{"mesh", 0}, {"translation", {3, 0, 0}}});
  fixture.json["scenes"] = {{{"nodes", {0}}}, {{"nodes", {1}}}};
  EXPECT_THAT(Origins(MustLoad(fixture)), ElementsAre(Vec3{0, 0, 0}));
  fixture.json["scene"] = 1;
  EXPECT_THAT(Origins(MustLoad(fixture)), ElementsAre(Vec3{3, 0, 0}));
  fixture.json["scene"] = 2;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("scene 2 does not exist (there are 2)"));
}

TEST(Nodes, FarFromTheOriginKeepTheirDistances) {
  for (const bool has_camera : {true, false}) {
    GltfFixture fixture = OneTriangle();
    fixture.json["nodes"][0]["translation"] = {0.05, 0, 0};
    fixture.AddNode({{"mesh", 0}, {"translation", {0.07, 0, 0}}});
    fixture.AddNode({{"children", {0, 1}}, {"translation", {500000.01, 35, -4649776.02}}});
    if (has_camera) {
      fixture.Add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 0.1}}}});
      fixture.AddNode({{"camera", 0}, {"translation", {500000.25, 36, -4649770}}});
      fixture.json["scenes"] = nlohmann::json::array({{{"nodes", {2, 3}}}});
    }
    const Scene scene = MustLoad(fixture);
    EXPECT_EQ(scene.origin[0], 500000);
    const auto origins = Origins(scene);
    ASSERT_EQ(origins.size(), 2u);
    EXPECT_NEAR(origins[0].x, 0.06, 1e-6);
    EXPECT_NEAR(origins[1].x - origins[0].x, 0.02, 1e-6);
    EXPECT_NEAR(origins[0].z + scene.origin[2], -4649776.02, 1e-6);
    if (has_camera) {
      EXPECT_NEAR(scene.cameras[0].world_from_camera.origin.x, 0.25, 1e-6);
    }
  }
  EXPECT_EQ(MustLoad(OneTriangle()).origin, Point64{});
}

TEST(Nodes, HideThemselvesAndAllBelowButNoCamera) {
  GltfFixture fixture = OneTriangle();
  fixture.Add("cameras", {{"type", "orthographic"},
                          {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"znear", 0.1}, {"zfar", 9}}}});
  fixture.AddNode({{"mesh", 0}, {"translation", {3, 0, 0}}});
  fixture.AddNode({{"children", {1}}, {"camera", 0}});
  fixture.json["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}};
  fixture.json["nodes"][1]["extensions"]["KHR_lights_punctual"] = {{"light", 0}};
  fixture.json["extensionsRequired"] = {"KHR_node_visibility"};
  EXPECT_EQ(MustLoad(fixture).instances.size(), 2u);
  EXPECT_EQ(MustLoad(fixture).lights.size(), 1u);
  fixture.json["nodes"][2]["extensions"]["KHR_node_visibility"] = {{"visible", false}};
  fixture.json["nodes"][1]["extensions"]["KHR_node_visibility"] = {{"visible", true}};
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(Origins(scene), ElementsAre(Vec3{0, 0, 0}));
  EXPECT_THAT(scene.lights, IsEmpty());
  EXPECT_EQ(scene.cameras.size(), 1u);
}

TEST(Nodes, PlaceGpuInstances) {
  GltfFixture fixture = TriangleOfOneNode();
  const int translations = fixture.AddFloats({1, 0, 0, 2, 0, 0}, "VEC3");
  const int rotations = fixture.AddShorts({0, 0, 0, 32767, 0, 0, 32767, 0}, "VEC4", true);
  const int scales = fixture.AddFloats({1, 1, 1, 3, 3, 3}, "VEC3");
  fixture.json["nodes"][0]["translation"] = {0, 10, 0};
  fixture.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
      {"TRANSLATION", translations}, {"ROTATION", rotations}, {"SCALE", scales}};
  fixture.json["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(Origins(scene), ElementsAre(Vec3{1, 10, 0}, Vec3{2, 10, 0}));
  EXPECT_NEAR(scene.instances[1].world_from_object.x.x, -3, 1e-5)
      << "half a turn about z, three times as large";
  LoadOptions options;
  options.limits.max_instances = 1;
  EXPECT_EQ(fixture.Load(options).status().code(), absl::StatusCode::kResourceExhausted);
  fixture.json["accessors"][scales]["count"] = 1;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("node 0: EXT_mesh_gpu_instancing: SCALE has 1 elements, others 2"));
}

TEST(Nodes, LeaveOutSingularInstancesWithAWarning) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.AddNode({{"mesh", 0}, {"scale", {1, 0, 1}}});
  const Scene scene = MustLoad(fixture);
  EXPECT_EQ(scene.instances.size(), 1u);
  EXPECT_THAT(scene.warnings, Contains(HasSubstr("left out: 1 (the first in node 1)")));
}

TEST(Nodes, RefuseCycles) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.json["nodes"] = {
      {{"children", {1}}, {"name", "a"}}, {{"children", {2}}}, {{"children", {1}}, {"mesh", 0}}};
  EXPECT_EQ(ErrorOf(fixture), "test.glb: node 1: is its own ancestor (a cycle)");
  fixture.json["nodes"] = {{{"children", {0}}, {"name", "a"}}};
  fixture.json["scenes"] = {{{"nodes", {0}}}};
  EXPECT_EQ(ErrorOf(fixture), "test.glb: node 0 \"a\": is its own ancestor (a cycle)");
}

TEST(Nodes, RefuseASecondParent) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.AddNode({{"children", {0}}});
  fixture.AddNode({{"children", {0}}});
  EXPECT_EQ(ErrorOf(fixture), "test.glb: node 0: has more than one parent");
}

TEST(Nodes, RefuseTooDeepNesting) {
  GltfFixture fixture = TriangleOfOneNode();
  for (int i = 0; i < 100'000; ++i) fixture.AddNode({{"children", {i}}});
  const auto scene = fixture.Load();
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(scene.status().message()), HasSubstr("node 99744: nested deeper than 256 nodes"));
}

TEST(Nodes, RefuseIndicesOfMissingObjects) {
  const auto changed = [](const char* field, const json& value) {
    GltfFixture fixture = TriangleOfOneNode();
    fixture.json["nodes"][0][field] = value;
    return ErrorOf(fixture);
  };
  EXPECT_THAT(changed("mesh", 5), HasSubstr("node 0: mesh 5 does not exist (there are 1)"));
  EXPECT_THAT(changed("mesh", -5), HasSubstr("node 0: mesh -5 does not exist"));
  EXPECT_THAT(changed("camera", 0), HasSubstr("node 0: camera 0 does not exist (there are 0)"));
  EXPECT_THAT(changed("children", {7}), HasSubstr("node 7 does not exist (there are 1)"));
  EXPECT_THAT(changed("children", {-1}), HasSubstr("node -1 does not exist"));
  EXPECT_THAT(changed("mesh", int64_t{1} << 32), HasSubstr("/nodes/0/mesh: 4294967296 is out of range"));
}

TEST(Nodes, RealNumbersMayBeLargeIntegers) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.Add("cameras", {{"type", "perspective"},
                          {"perspective", {{"yfov", 1}, {"znear", 0.1}, {"zfar", int64_t{999999995904}}}}});
  fixture.json["nodes"][0]["translation"] = {0, 0, int64_t{1} << 29};
  fixture.json["nodes"][0]["camera"] = 0;
  EXPECT_TRUE(fixture.Load().ok()) << fixture.Load().status();
}

TEST(Nodes, RefuseMalformedTransforms) {
  const auto changed = [](const char* field, const json& value) {
    GltfFixture fixture = TriangleOfOneNode();
    fixture.json["nodes"][0][field] = value;
    return ErrorOf(fixture);
  };
  EXPECT_THAT(changed("matrix", {1, 2, 3}), HasSubstr("node 0: matrix has 3 numbers, not 16"));
  EXPECT_THAT(changed("matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.5, 0, 0, 0, 1}),
              HasSubstr("node 0: matrix has a last row other than 0 0 0 1"));
  EXPECT_THAT(changed("rotation", {0, 0, 0, 0}), HasSubstr("node 0: rotation is no quaternion"));
  EXPECT_THAT(changed("translation", {0, 1e39, 0}), HasSubstr("node 0: translation is not finite"));
  EXPECT_THAT(changed("scale", {1, 1}), HasSubstr("node 0: scale has 2 numbers, not 3"));
}

TEST(Nodes, PlaceCamerasWithoutTheirScale) {
  GltfFixture fixture = TriangleOfOneNode();
  fixture.Add("cameras", {{"type", "perspective"},
                          {"name", "lens"},
                          {"perspective", {{"yfov", 0.5}, {"znear", 0.1}, {"aspectRatio", 1.5}}}});
  fixture.Add("cameras", {{"type", "orthographic"},
                          {"orthographic", {{"xmag", 4}, {"ymag", 2}, {"znear", 0}, {"zfar", 9}}}});
  fixture.AddNode({{"camera", 0}, {"name", "Front"}, {"translation", {0, 0, 7}}, {"scale", {2, 2, 2}}});
  fixture.AddNode({{"camera", 0}});
  fixture.AddNode({{"camera", 1}});
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.cameras.size(), 3u);
  EXPECT_EQ(scene.cameras[0].name, "Front");
  EXPECT_EQ(scene.cameras[0].kind, Camera::Kind::kPerspective);
  EXPECT_EQ(scene.cameras[0].yfov, 0.5f);
  EXPECT_EQ(scene.cameras[0].aspect, 1.5f);
  EXPECT_EQ(scene.cameras[0].world_from_camera.origin, (Vec3{0, 0, 7}));
  EXPECT_EQ(scene.cameras[0].world_from_camera.z, (Vec3{0, 0, 1}));
  EXPECT_EQ(scene.cameras[1].name, "lens");
  EXPECT_EQ(scene.cameras[2].name, "camera1");
  EXPECT_EQ(scene.cameras[2].kind, Camera::Kind::kOrthographic);
  EXPECT_EQ(scene.cameras[2].aspect, 2);
  EXPECT_THAT(scene.warnings, IsEmpty());
}

TEST(Nodes, RefuseMalformedCameras) {
  const auto changed = [](const json& camera) {
    GltfFixture fixture = TriangleOfOneNode();
    fixture.Add("cameras", camera);
    fixture.AddNode({{"camera", 0}});
    return ErrorOf(fixture);
  };
  EXPECT_THAT(changed({{"type", "perspective"}, {"perspective", {{"yfov", 3.2}, {"znear", 1}}}}),
              HasSubstr("node 1: camera 0: yfov must lie between 0 and pi"));
  EXPECT_THAT(changed({{"type", "perspective"}, {"perspective", {{"yfov", 0}, {"znear", 1}}}}),
              HasSubstr("yfov"));
  EXPECT_THAT(
      changed({{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 1}, {"aspectRatio", -1}}}}),
      HasSubstr("aspectRatio must be positive"));
  EXPECT_THAT(changed({{"type", "orthographic"},
                       {"orthographic", {{"xmag", 0}, {"ymag", 2}, {"znear", 0}, {"zfar", 9}}}}),
              HasSubstr("xmag and ymag must be positive"));
  EXPECT_THAT(changed({{"type", "fisheye"}}), HasSubstr("fisheye"));
}

TEST(Nodes, NoteThatThereIsNoCamera) {
  EXPECT_THAT(MustLoad(TriangleOfOneNode()).warnings,
              ElementsAre("no camera: one that sees everything is used"));
}

}  // namespace
}  // namespace lumifold::scene
