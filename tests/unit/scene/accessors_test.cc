#include "worker/scene/accessors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "tests/support/gltf_fixture.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

/// Loads a fixture with one triangle mesh and returns that mesh.
Mesh OnlyMesh(const GltfFixture& fixture) {
  const auto scene = fixture.Load();
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok() || scene->meshes.size() != 1) {
    ADD_FAILURE() << "expected one mesh";
    return {};
  }
  return scene->meshes[0];
}

TEST(Accessors, ReadInterleavedAttributes) {
  GltfFixture fixture;
  const std::vector<float> vertices = {0, 0, 0, 0.5f, 0.25f, 1, 0, 0, 1, 2, 0, 1, 0, 3, 4};
  const int view =
      fixture.AddView({reinterpret_cast<const char*>(vertices.data()), vertices.size() * sizeof(float)}, 20);
  const int position = fixture.Add(
      "accessors", {{"bufferView", view}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}});
  const int uv = fixture.Add(
      "accessors",
      {{"bufferView", view}, {"byteOffset", 12}, {"componentType", 5126}, {"count", 3}, {"type", "VEC2"}});
  fixture.AddNode(
      {{"mesh", fixture.AddMesh({{"attributes", {{"POSITION", position}, {"TEXCOORD_0", uv}}}})}});
  const Mesh mesh = OnlyMesh(fixture);
  EXPECT_THAT(mesh.positions, ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{0, 1, 0}));
  ASSERT_EQ(mesh.uvs[0].size(), 3u);
  EXPECT_EQ(mesh.uvs[0][0].y, 0.25f);
  EXPECT_EQ(mesh.uvs[0][2].x, 3);
  EXPECT_EQ(mesh.uvs[0][2].y, 4);
}

TEST(Accessors, ScaleNormalizedIntegersAsGltfSays) {
  GltfFixture fixture;
  const int uv = fixture.AddBytes({0, 255, 51, 0, 255, 255}, "VEC2", true);
  const int color = fixture.AddBytes({255, 0, 51, 0, 0, 0, 0, 0, 0}, "VEC3", true);
  fixture.AddTriangles(kTriangle, {{"attributes", {{"TEXCOORD_0", uv}, {"COLOR_0", color}}}});
  const Mesh mesh = OnlyMesh(fixture);
  EXPECT_EQ(mesh.uvs[0][0].y, 1.0f);
  EXPECT_EQ(mesh.uvs[0][1].x, 0.2f);
  EXPECT_EQ(mesh.colors[0].x, 1.0f);
  EXPECT_EQ(mesh.colors[0].z, 0.2f);
  EXPECT_EQ(mesh.colors[0].w, 1.0f) << "RGB gets alpha 1";
}

TEST(Accessors, ReadQuantizedPositions) {
  GltfFixture fixture;
  const int raw = fixture.AddShorts({0, 0, 0, 500, 0, 0, 0, -7, 0}, "VEC3", false);
  fixture.AddNode({{"mesh", fixture.AddMesh({{"attributes", {{"POSITION", raw}}}})}});
  const int normalized = fixture.AddShorts({32767, 0, 0, -32768, 0, 0, 0, 32767, 0}, "VEC3", true);
  fixture.AddNode({{"mesh", fixture.AddMesh({{"attributes", {{"POSITION", normalized}}}})}});
  const auto scene = fixture.Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->meshes[0].positions, ElementsAre(Vec3{0, 0, 0}, Vec3{500, 0, 0}, Vec3{0, -7, 0}));
  EXPECT_THAT(scene->meshes[1].positions, ElementsAre(Vec3{1, 0, 0}, Vec3{-1, 0, 0}, Vec3{0, 1, 0}));
}

TEST(Accessors, ReadIndicesOfEveryWidth) {
  for (const int component_type : {5121, 5123, 5125}) {
    GltfFixture fixture;
    const size_t bytes = component_type == 5121 ? 1 : component_type == 5123 ? 2 : 4;
    std::string data(3 * bytes, '\0');
    for (size_t i = 0; i < 3; ++i) data[i * bytes] = static_cast<char>(2 - i);
    const int indices = fixture.Add("accessors", {{"bufferView", fixture.AddView(data)},
                                                  {"componentType", component_type},
                                                  {"count", 3},
                                                  {"type", "SCALAR"}});
    fixture.AddTriangles(kTriangle, {{"indices", indices}});
    EXPECT_THAT(OnlyMesh(fixture).triangles, ElementsAre(2u, 1u, 0u)) << component_type;
  }
}

/// Gives accessor `accessor` a sparse part that replaces the elements `targets`.
void MakeSparse(GltfFixture* fixture, int accessor, const std::vector<uint8_t>& targets,
                const std::vector<float>& values) {
  const int target_view = fixture->AddView({reinterpret_cast<const char*>(targets.data()), targets.size()});
  const int value_view =
      fixture->AddView({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)});
  fixture->json["accessors"][accessor]["sparse"] = {
      {"count", targets.size()},
      {"indices", {{"bufferView", target_view}, {"componentType", 5121}}},
      {"values", {{"bufferView", value_view}}}};
}

TEST(Accessors, ApplySparseValues) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  MakeSparse(&fixture, 0, {1}, {5, 6, 7});
  EXPECT_THAT(OnlyMesh(fixture).positions, ElementsAre(Vec3{0, 0, 0}, Vec3{5, 6, 7}, Vec3{0, 1, 0}));
}

TEST(Accessors, ApplySparseIndicesOfEveryWidth) {
  for (const int component_type : {5121, 5123, 5125}) {
    const size_t bytes = component_type == 5121 ? 1 : component_type == 5123 ? 2 : 4;
    const auto view_of = [bytes](GltfFixture* fixture, const std::vector<int>& values) {
      std::string data(values.size() * bytes, '\0');
      for (size_t i = 0; i < values.size(); ++i) data[i * bytes] = static_cast<char>(values[i]);
      return fixture->AddView(data);
    };
    GltfFixture fixture;
    const int indices = fixture.Add("accessors", {{"bufferView", view_of(&fixture, {0, 1, 2, 2, 1, 0})},
                                                  {"componentType", component_type},
                                                  {"count", 6},
                                                  {"type", "SCALAR"}});
    fixture.json["accessors"][indices]["sparse"] = {
        {"count", 2},
        {"indices", {{"bufferView", view_of(&fixture, {1, 5})}, {"componentType", component_type}}},
        {"values", {{"bufferView", view_of(&fixture, {3, 3})}}}};
    fixture.AddTriangles({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, {{"indices", indices}});
    EXPECT_THAT(OnlyMesh(fixture).triangles, ElementsAre(0u, 3u, 2u, 2u, 1u, 3u)) << component_type;
  }
}

TEST(Accessors, StartSparseValuesFromZeroWithoutABufferView) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  MakeSparse(&fixture, 0, {0, 2}, {1, 1, 1, 2, 0, 0});
  fixture.json["accessors"][0].erase("bufferView");
  EXPECT_THAT(OnlyMesh(fixture).positions, ElementsAre(Vec3{1, 1, 1}, Vec3{0, 0, 0}, Vec3{2, 0, 0}));
}

TEST(Accessors, RefuseSparseIndicesOutOfRange) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  MakeSparse(&fixture, 0, {3}, {5, 6, 7});
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("accessor 0: sparse index 3 is out of range (3 elements)"));
}

TEST(Accessors, RefuseSparsePartsThatLeaveTheirViews) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  MakeSparse(&fixture, 0, {1}, {5, 6, 7});
  fixture.json["accessors"][0]["sparse"]["values"]["byteOffset"] = 4;
  EXPECT_THAT(ErrorOf(fixture),
              HasSubstr("accessor 0: sparse values: 1 elements from byte 4 leave buffer view 2"));
  fixture.json["accessors"][0]["sparse"]["count"] = -1;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("count"));
}

TEST(Accessors, RefuseValuesThatAreNotFinite) {
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
                          -std::numeric_limits<float>::infinity()}) {
    GltfFixture fixture;
    std::vector<float> positions = kTriangle;
    positions[4] = bad;
    fixture.AddTriangles(positions);
    EXPECT_THAT(ErrorOf(fixture),
                HasSubstr("test.glb: mesh 0 primitive 0: POSITION: accessor 0: element 1 is not finite"));
  }
}

TEST(Accessors, RefuseToReadBeyondTheirView) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.json["accessors"][0]["count"] = 4;
  EXPECT_THAT(ErrorOf(fixture),
              HasSubstr("accessor 0: 4 elements from byte 0 leave buffer view 0 of 36 bytes"));
  fixture.json["accessors"][0]["count"] = 3;
  fixture.json["accessors"][0]["byteOffset"] = 1;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("leave buffer view 0"));
}

TEST(Accessors, RefuseOffsetsAndCountsThatOverflow) {
  const uint64_t huge = std::numeric_limits<uint64_t>::max();
  for (const char* field : {"count", "byteOffset"}) {
    for (const uint64_t value : {huge, huge - 35, huge / 12, huge / 12 + 1, uint64_t{1} << 63}) {
      GltfFixture fixture;
      fixture.AddTriangles(kTriangle);
      fixture.json["accessors"][0][field] = value;
      EXPECT_FALSE(fixture.Load().ok()) << field << " " << value;
    }
  }
  for (const char* field : {"byteLength", "byteOffset"}) {
    for (const uint64_t value : {huge, huge - 35, huge - 36, uint64_t{1} << 63}) {
      GltfFixture fixture;
      fixture.AddTriangles(kTriangle);
      fixture.json["bufferViews"][0][field] = value;
      EXPECT_THAT(ErrorOf(fixture), HasSubstr("leave buffer 0")) << field << " " << value;
    }
  }
}

TEST(Accessors, RefuseAbsurdCountsWithoutData) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.json["accessors"][0].erase("bufferView");
  fixture.json["accessors"][0]["count"] = 500'000'000;
  const auto scene = fixture.Load();
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(scene.status().message()),
              HasSubstr("accessor 0: 500000000 elements without a buffer view"));
}

TEST(Accessors, RefuseAStrideBelowTheElement) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.json["bufferViews"][0]["byteStride"] = 8;
  EXPECT_THAT(ErrorOf(fixture),
              HasSubstr("byteStride 8 of buffer view 0 is less than an element of 12 bytes"));
}

TEST(Accessors, RefuseIndicesOfMissingObjects) {
  const auto changed = [](const char* section, const char* field, int value) {
    GltfFixture fixture;
    fixture.AddTriangles(kTriangle);
    fixture.json[section][0][field] = value;
    return fixture;
  };
  EXPECT_THAT(ErrorOf(changed("accessors", "bufferView", 7)),
              HasSubstr("buffer view 7 does not exist (there are 1)"));
  EXPECT_THAT(ErrorOf(changed("accessors", "bufferView", -2)), HasSubstr("buffer view -2 does not exist"));
  EXPECT_THAT(ErrorOf(changed("bufferViews", "buffer", 3)),
              HasSubstr("buffer 3 does not exist (there are 1)"));
  EXPECT_THAT(ErrorOf(changed("bufferViews", "buffer", -1)), HasSubstr("buffer -1 does not exist"));
  EXPECT_THAT(ErrorOf(changed("accessors", "componentType", 5130)),
              HasSubstr("component type 5130 is not glTF's"));
  EXPECT_THAT(ErrorOf(changed("accessors", "componentType", 5125)), HasSubstr("indices only"));
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9;
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("accessor 9: does not exist (there are 1)"));
}

TEST(Accessors, RefuseAnotherType) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  fixture.json["accessors"][0]["type"] = "VEC2";
  EXPECT_THAT(ErrorOf(fixture), HasSubstr("accessor 0: does not hold elements of 3 components"));
}

}  // namespace
}  // namespace lumifold::scene
