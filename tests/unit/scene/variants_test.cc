#include "worker/scene/variants.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::IsEmpty;

/// A shoe in two variants; the textures of all materials are missing files.
GltfFixture Shoe() {
  GltfFixture fixture;
  for (const char* name : {"default", "red", "blue"}) {
    fixture.Add("images", {{"uri", std::string(name) + ".png"}});
    const int texture = fixture.Add("textures", {{"source", fixture.json["images"].size() - 1}});
    fixture.Add("materials", {{"name", name}, {"normalTexture", {{"index", texture}}}});
  }
  fixture.json["extensions"]["KHR_materials_variants"]["variants"] = {{{"name", "Red"}}, {{"name", "Blue"}}};
  const json mappings = {{{"material", 1}, {"variants", {0}}}, {{"material", 2}, {"variants", {1}}}};
  fixture.AddTriangles(
      kTriangle, {{"material", 0}, {"extensions", {{"KHR_materials_variants", {{"mappings", mappings}}}}}});
  return fixture;
}

/// The names of the pictures that a variant reads.
std::vector<std::string> FilesOf(const std::string& variant) {
  std::vector<std::string> files;
  const AssetReader reader = [&](const std::string& uri) -> absl::StatusOr<std::string> {
    files.push_back(uri);
    return EncodePng(1, 1, 1, 8, false, {9});
  };
  LoadOptions options;
  options.variant = variant;
  const auto scene = LoadGltf(Shoe().Glb(), "shoe.glb", reader, options);
  EXPECT_TRUE(scene.ok()) << scene.status();
  return files;
}

TEST(Variants, AreChosenByNameOrNumberAndReadOnlyWhatTheyShow) {
  EXPECT_THAT(FilesOf(""), ElementsAre("default.png"));
  EXPECT_THAT(FilesOf("Red"), ElementsAre("red.png"));
  EXPECT_THAT(FilesOf("1"), ElementsAre("blue.png"));
}

TEST(Variants, AreNamedWhereOneIsMissing) {
  LoadOptions options;
  options.variant = "Green";
  EXPECT_EQ(
      Shoe().Load(options).status(),
      absl::NotFoundError("test.glb: the scene has no variant called 'Green'; there are: 0 'Red', 1 'Blue'"));
  GltfFixture plain;
  plain.AddTriangles(kTriangle);
  EXPECT_EQ(plain.Load(options).status(),
            absl::NotFoundError("test.glb: the scene has no variant called 'Green'; it has no variant"));
}

TEST(Variants, OfMalformedMappingsAreIgnored) {
  GltfFixture fixture = Shoe();
  fixture.json["images"] = json::array();
  fixture.json["textures"] = json::array();
  for (json& material : fixture.json["materials"]) material.erase("normalTexture");
  json& mappings = fixture.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"];
  mappings["mappings"] = {
      3, {{"variants", "all"}}, {{"variants", {0}}}, {{"variants", {0}}, {"material", 1}}};
  LoadOptions options;
  options.variant = "Red";
  const auto scene = fixture.Load(options);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->meshes[0].material, 1);
  EXPECT_THAT(scene->variants, ElementsAre("Red", "Blue"));
  mappings["mappings"][3]["material"] = 77;
  EXPECT_FALSE(fixture.Load(options).ok());
}

}  // namespace
}  // namespace lumifold::scene
