#include "worker/scene/gltf_loader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "absl/strings/escaping.h"
#include "tests/support/gltf_fixture.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

std::string ErrorOf(std::string_view bytes) {
  const auto scene = LoadGltf(bytes, "test.glb", NoFiles);
  EXPECT_FALSE(scene.ok());
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kInvalidArgument);
  return std::string(scene.status().message());
}

TEST(GltfLoader, ReadsBinaryAndTextEqually) {
  const GltfFixture fixture = OneTriangle();
  const std::string data_uri = "data:application/octet-stream;base64," + absl::Base64Escape(fixture.binary);
  const auto from_glb = LoadGltf(fixture.Glb(), "a.glb", NoFiles);
  const auto from_text = LoadGltf(fixture.Text(data_uri), "a.gltf", NoFiles);
  ASSERT_TRUE(from_glb.ok()) << from_glb.status();
  ASSERT_TRUE(from_text.ok()) << from_text.status();
  EXPECT_EQ(from_glb->meshes[0].positions, from_text->meshes[0].positions);
}

TEST(GltfLoader, ReadsTextWithAByteOrderMark) {
  const GltfFixture fixture = OneTriangle();
  const std::string text =
      "\xEF\xBB\xBF" + fixture.Text("data:;base64," + absl::Base64Escape(fixture.binary));
  EXPECT_TRUE(LoadGltf(text, "a.gltf", NoFiles).ok());
}

TEST(GltfLoader, AsksTheReaderForDecodedUrisOnly) {
  GltfFixture fixture = OneTriangle();
  fixture.Add("images", {{"uri", "textures/a+b%20c.png"}});
  fixture.Add("textures", {{"source", 0}});
  fixture.Add("materials", {{"normalTexture", {{"index", 0}}}});
  std::vector<std::string> asked;
  const AssetReader reader = [&](const std::string& uri) -> absl::StatusOr<std::string> {
    asked.push_back(uri);
    if (uri == "my scene.bin") return fixture.binary;
    return EncodePng(1, 1, 1, 8, false, {9});
  };
  const auto scene = LoadGltf(fixture.Text("my%20scene.bin"), "a.gltf", reader);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(asked, testing::UnorderedElementsAre("my scene.bin", "textures/a+b c.png"));
  EXPECT_EQ(scene->images[0]->rgba[0], 9);
}

TEST(GltfLoader, ReturnsTheReadersOwnError) {
  const auto scene = LoadGltf(OneTriangle().Text("scene.bin"), "a.gltf", NoFiles);
  EXPECT_EQ(scene.status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(scene.status().message(), "a.gltf: buffer 0: scene.bin does not exist");
}

TEST(GltfLoader, RefusesAShortExternalBuffer) {
  const AssetReader reader = [](const std::string&) { return std::string("short"); };
  const auto scene = LoadGltf(OneTriangle().Text("scene.bin"), "a.gltf", reader);
  EXPECT_EQ(scene.status().message(), "a.gltf: buffer 0: cut short: byteLength is 36, there are 5 bytes");
}

TEST(GltfLoader, RefusesDataThatIsNotGltf) {
  EXPECT_EQ(ErrorOf(""), "test.glb: not glTF: neither a GLB nor a JSON object");
  EXPECT_EQ(ErrorOf("solid cube"), "test.glb: not glTF: neither a GLB nor a JSON object");
  EXPECT_EQ(ErrorOf("{}"), "test.glb: not glTF: no \"asset\" object");
  EXPECT_EQ(ErrorOf(R"({"asset": 5})"), "test.glb: not glTF: no \"asset\" object");
  EXPECT_EQ(ErrorOf(R"({"asset": {"version": "1.0"}})"), "test.glb: glTF version 1.0, only 2.x is read");
  EXPECT_THAT(ErrorOf("{\"asset\":\n\n nonsense}"),
              StartsWith("test.glb: malformed glTF: parse error at line 3"));
  EXPECT_THAT(ErrorOf("{\"asset\":\n\n nonsense}"), Not(HasSubstr("\n")));
}

TEST(GltfLoader, RefusesMalformedContainers) {
  const std::string glb = OneTriangle().Glb();
  std::string version = glb;
  version[4] = 1;
  EXPECT_EQ(ErrorOf(version), "test.glb: GLB version 1, only 2 is read");
  EXPECT_THAT(ErrorOf(glb.substr(0, glb.size() - 1)), HasSubstr("GLB cut short: its header says"));
  std::string chunk = glb;
  chunk[16] = 'X';
  EXPECT_EQ(ErrorOf(chunk), "test.glb: GLB whose first chunk is not JSON");
  std::string length = glb;
  length[14] = 1;
  EXPECT_THAT(ErrorOf(length), HasSubstr("GLB cut short: a chunk of"));
  EXPECT_EQ(ErrorOf(MakeGlb(R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":4}]})", "")),
            "test.glb: buffer 0: neither a uri nor a GLB's binary part");
}

TEST(GltfLoader, RefusesRequiredExtensionsItDoesNotKnow) {
  GltfFixture fixture = OneTriangle();
  fixture.json["extensionsRequired"] = {"KHR_mesh_quantization", "EXT_lights_ies"};
  EXPECT_EQ(ErrorOf(fixture.Glb()),
            "test.glb: requires the extension EXT_lights_ies, which is not supported");
}

TEST(GltfLoader, NotesUsedExtensionsItDoesNotKnowAndWhatIsLost) {
  GltfFixture fixture = OneTriangle();
  fixture.json["extensionsUsed"] = {"KHR_materials_ior", "EXT_lights_image_based", "ACME_smell",
                                    "ACME_smell"};
  const auto scene = fixture.Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(
      scene->warnings,
      ElementsAre("extension EXT_lights_image_based is not supported: its environment light is left out",
                  "extension ACME_smell is not supported: what it describes is left out",
                  "no camera: one that sees everything is used"));
}

TEST(GltfLoader, RefusesDeeplyNestedJson) {
  for (const char* bracket : {"[", "{\"a\":"}) {
    std::string text = R"({"asset":{"version":"2.0"},"extras":)";
    for (int i = 0; i < 200'000; ++i) text += bracket;
    EXPECT_EQ(ErrorOf(text), "test.glb: JSON nested deeper than 128 levels");
  }
  const std::string brackets_in_a_string = std::string(1000, '[') + "\\\"" + std::string(1000, '{');
  EXPECT_TRUE(
      LoadGltf(R"({"asset":{"version":"2.0"},"extras":")" + brackets_in_a_string + "\"}", "a", NoFiles).ok());
}

TEST(GltfLoader, RefusesSectionsOfTheWrongType) {
  for (const char* section : {"buffers", "images"}) {
    GltfFixture fixture = OneTriangle();
    fixture.json[section] = 5;
    EXPECT_THAT(ErrorOf(fixture.Glb()), HasSubstr("is not an array"));
    fixture.json[section] = {1};
    EXPECT_THAT(ErrorOf(fixture.Glb()), HasSubstr("[0] is not an object"));
  }
  for (const char* section :
       {"accessors", "bufferViews", "meshes", "nodes", "materials", "cameras", "textures"}) {
    GltfFixture fixture = OneTriangle();
    fixture.json[section] = {1, "two"};
    EXPECT_THAT(ErrorOf(fixture.Glb()), HasSubstr(section));
  }
}

TEST(GltfLoader, RefusesPrimitivesThatTinygltfWouldSkip) {
  GltfFixture fixture = OneTriangle();
  fixture.json["meshes"][0]["primitives"][0].erase("attributes");
  EXPECT_THAT(ErrorOf(fixture.Glb()), HasSubstr("attributes"));
}

TEST(GltfLoader, KeepsMessagesOnOneLine) {
  GltfFixture fixture = OneTriangle();
  fixture.json["nodes"][0]["name"] = "two\nlines";
  fixture.json["nodes"][0]["mesh"] = 3;
  EXPECT_EQ(ErrorOf(fixture.Glb()), "test.glb: node 0 \"two lines\": mesh 3 does not exist (there are 1)");
}

TEST(GltfLoader, AcceptsAnEmptyScene) {
  GltfFixture fixture;
  const auto scene = fixture.Load();
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(scene->instances, IsEmpty());
  EXPECT_THAT(scene->warnings, Contains("no triangles: there is nothing to see"));
}

void Write(const std::string& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

TEST(GltfFile, FindsExternalFilesBesideIt) {
  const TempFolder folder;
  std::filesystem::create_directory(folder.PathOf("textures"));
  GltfFixture fixture = OneTriangle();
  fixture.Add("images", {{"uri", "textures/a%20b.png"}});
  fixture.Add("textures", {{"source", 0}});
  fixture.Add("materials", {{"normalTexture", {{"index", 0}}}});
  Write(folder.PathOf("scene.bin"), fixture.binary);
  Write(folder.PathOf("textures/a b.png"), EncodePng(1, 1, 1, 8, false, {9}));
  Write(folder.PathOf("scene.gltf"), fixture.Text("scene.bin"));
  const auto scene = LoadGltfFile(folder.PathOf("scene.gltf"));
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes.size(), 1u);
  EXPECT_EQ(scene->images.size(), 1u);
}

TEST(GltfFile, NamesWhatIsMissing) {
  const TempFolder folder;
  const std::string path = folder.PathOf("scene.gltf");
  Write(path, OneTriangle().Text("gone.bin"));
  const auto scene = LoadGltfFile(path);
  EXPECT_THAT(std::string(scene.status().message()), StartsWith(path + ": buffer 0: "));
  EXPECT_THAT(std::string(scene.status().message()), HasSubstr("gone.bin"));
  const std::string missing = folder.PathOf("missing.glb");
  EXPECT_EQ(LoadGltfFile(missing).status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(LoadGltfFile(missing).status().message()), HasSubstr(missing));
}

TEST(GltfFile, RefusesPathsThatAreNotRelative) {
  const TempFolder folder;
  for (const char* uri : {"/etc/hostname", "http://example.org/scene.bin"}) {
    Write(folder.PathOf("scene.gltf"), OneTriangle().Text(uri));
    const auto scene = LoadGltfFile(folder.PathOf("scene.gltf"));
    EXPECT_THAT(std::string(scene.status().message()), HasSubstr("is not a path relative to the scene"));
  }
}

}  // namespace
}  // namespace lumifold::scene
