#include "worker/scene/compressed_views.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <array>

#include "nlohmann/json.hpp"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

/// A square of two triangles of which all buffer views are compressed, as gltfpack writes it.
class CompressedSquare {
 public:
  CompressedSquare() {
    const std::vector<std::array<float, 3>> corners = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    std::string code(meshopt_encodeVertexBufferBound(corners.size(), 12), '\0');
    code.resize(meshopt_encodeVertexBuffer(Data(code), code.size(), corners.data(), corners.size(), 12));
    AddView(code, {{"mode", "ATTRIBUTES"}, {"byteStride", 12}, {"count", 4}}, 48);
    const std::vector<unsigned> indices = {0, 1, 2, 0, 2, 3};
    code.resize(meshopt_encodeIndexBufferBound(indices.size(), corners.size()));
    code.resize(meshopt_encodeIndexBuffer(Data(code), code.size(), indices.data(), indices.size()));
    AddView(code, {{"mode", "TRIANGLES"}, {"byteStride", 2}, {"count", 6}}, 12);
    glb.json["accessors"] = {{{"bufferView", 0}, {"componentType", 5126}, {"count", 4}, {"type", "VEC3"}},
                             {{"bufferView", 1}, {"componentType", 5123}, {"count", 6}, {"type", "SCALAR"}}};
    glb.AddNode({{"mesh", glb.AddMesh({{"attributes", {{"POSITION", 0}}}, {"indices", 1}})}});
    glb.json["extensionsRequired"] = {"EXT_meshopt_compression"};
  }

  json& Extension(int view) { return glb.json["bufferViews"][view]["extensions"]["EXT_meshopt_compression"]; }

  std::string Glb() const {
    json document = glb.FullJson();
    document["buffers"].push_back(
        {{"byteLength", 60}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}});
    return MakeGlb(document.dump(), glb.binary);
  }

  absl::StatusOr<Scene> Load() const { return LoadGltf(Glb(), "test.glb", NoFiles); }
  std::string Error() const { return std::string(Load().status().message()); }

  GltfFixture glb;

 private:
  static unsigned char* Data(std::string& code) { return reinterpret_cast<unsigned char*>(code.data()); }

  /// A view of the buffer without bytes whose content is `code`.
  void AddView(const std::string& code, json extension, int bytes) {
    const int view = glb.AddView(code);
    json& written = glb.json["bufferViews"][view];
    extension.update({{"buffer", 0},
                      {"byteOffset", written.value("byteOffset", 0)},
                      {"byteLength", written["byteLength"]}});
    written = {
        {"buffer", 1}, {"byteLength", bytes}, {"extensions", {{"EXT_meshopt_compression", extension}}}};
  }
};

TEST(CompressedViews, HoldAttributesAndTriangles) {
  const auto scene = CompressedSquare().Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->meshes.size(), 1u);
  EXPECT_THAT(scene->meshes[0].positions,
              ElementsAre(Vec3{0, 0, 0}, Vec3{1, 0, 0}, Vec3{1, 1, 0}, Vec3{0, 1, 0}));
  EXPECT_THAT(scene->meshes[0].triangles, ElementsAre(0, 1, 2, 0, 2, 3));
  EXPECT_THAT(scene->warnings, ElementsAre("no camera: one that sees everything is used"));
}

TEST(CompressedViews, HaveTheNewNameOfTheExtension) {
  CompressedSquare square;
  json& extensions = square.glb.json["bufferViews"][0]["extensions"];
  extensions = {{"KHR_meshopt_compression", extensions["EXT_meshopt_compression"]}};
  square.glb.json["extensionsRequired"] = {"KHR_meshopt_compression", "EXT_meshopt_compression"};
  EXPECT_TRUE(square.Load().ok()) << square.Error();
}

TEST(CompressedViews, AreRefusedWhereTheyAreDamagedOrClaimTooMuch) {
  const auto error_with = [](int view, const char* key, const json& value) {
    CompressedSquare square;
    square.Extension(view)[key] = value;
    return square.Error();
  };
  EXPECT_THAT(error_with(0, "byteLength", 1u << 30), HasSubstr("compressed buffer view 0: 1073741824 bytes"));
  EXPECT_THAT(error_with(0, "byteLength", 9), HasSubstr("damaged meshopt data"));
  EXPECT_THAT(error_with(0, "count", 1u << 30), HasSubstr("claims 1073741824 elements, but has only"));
  EXPECT_THAT(error_with(0, "byteStride", 6), HasSubstr("byteStride 6 does not fit its mode"));
  EXPECT_THAT(error_with(0, "filter", "OCTAHEDRAL"), HasSubstr("byteStride 12 does not fit its mode"));
  EXPECT_THAT(error_with(0, "filter", "BLUR"), HasSubstr("filter \"BLUR\" is not known"));
  EXPECT_THAT(error_with(0, "mode", "SOUND"), HasSubstr("mode \"SOUND\" is not known"));
  EXPECT_THAT(error_with(0, "buffer", 7), HasSubstr("leave buffer 7 of 0 bytes"));
  EXPECT_THAT(error_with(1, "count", 7), HasSubstr("count 7 is not that of triangles"));
  EXPECT_THAT(error_with(1, "filter", "EXPONENTIAL"), HasSubstr("a filter on indices"));
  EXPECT_THAT(error_with(1, "count", "six"), HasSubstr("compressed buffer view 1: no count"));
  CompressedSquare longer;
  longer.glb.json["bufferViews"][0]["byteLength"] = 49;
  EXPECT_THAT(longer.Error(), HasSubstr("49 bytes of 48 decoded ones"));
}

TEST(CompressedViews, ReadColoursOfAFilter) {
  // Luma 100, differences 20 and -10, and alpha of seven bits whose highest bit says the scale.
  const std::array<uint8_t, 8> filtered = {100, 20, 246, 0x7f, 0, 0, 0, 0x40};
  std::string code(meshopt_encodeVertexBufferBound(2, 4), '\0');
  code.resize(meshopt_encodeVertexBuffer(reinterpret_cast<unsigned char*>(code.data()), code.size(),
                                         filtered.data(), 2, 4));
  CompressedView view;
  view.length = code.size();
  view.stride = 4;
  view.count = 2;
  view.filter = CompressedView::Filter::kColor;
  const auto bytes = DecodeView(view, {code});
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  const auto value = [&](int i) { return int{static_cast<uint8_t>((*bytes)[i])}; };
  // (100 + 20 + 10, 100 - 10, 100 - 20 + 10) of 127, and alpha 127 of 127.
  EXPECT_THAT((std::array{value(0), value(1), value(2), value(3)}), ElementsAre(255, 181, 181, 255));
  EXPECT_THAT((std::array{value(4), value(5), value(6), value(7)}), ElementsAre(0, 0, 0, 0));
}

}  // namespace
}  // namespace lumifold::scene
