#include "worker/scene/materials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/gltf_fixture.h"
#include "tests/unit/scene/load.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

/// A document with one image, one texture of it, and this material on a triangle.
GltfFixture WithMaterial(const json& material) {
  GltfFixture fixture;
  fixture.Add("images",
              {{"bufferView", fixture.AddView(EncodePng(2, 1, 3, 8, false, {255, 0, 0, 0, 255, 0}))},
               {"name", "flag"}});
  fixture.Add("textures", {{"source", 0}});
  fixture.Add("materials", material);
  fixture.AddTriangles(kTriangle, {{"material", 0}});
  return fixture;
}

Material MaterialOf(const json& material) {
  const Scene scene = MustLoad(WithMaterial(material));
  return scene.materials.empty() ? Material{} : scene.materials[0];
}

TEST(Materials, HaveGltfsDefaults) {
  const Material m = MaterialOf(json::object());
  EXPECT_EQ(m.base.color, (Vec3{1, 1, 1}));
  EXPECT_EQ(m.base.alpha, 1);
  EXPECT_EQ(m.base.metallic, 1);
  EXPECT_EQ(m.base.roughness, 1);
  EXPECT_EQ(m.emission.radiance, (Vec3{0, 0, 0}));
  EXPECT_EQ(m.alpha_mode, AlphaMode::kOpaque);
  EXPECT_EQ(m.alpha_cutoff, 0.5f);
  EXPECT_EQ(m.ior, 1.5f);
  EXPECT_EQ(m.specular.factor, 1);
  EXPECT_EQ(m.transmission.factor, 0);
  EXPECT_FALSE(m.double_sided || m.unlit || m.volume.is_solid);
  EXPECT_EQ(m.base.color_texture.texture, kNone);
}

TEST(Materials, HaveTheDefaultsOfExtensionsThatSayNothing) {
  json extensions;
  for (const char* name : {"ior", "specular", "transmission", "volume", "clearcoat", "sheen", "anisotropy",
                           "diffuse_transmission", "iridescence", "dispersion", "emissive_strength"})
    extensions[std::string("KHR_materials_") + name] = json::object();
  const Material m = MaterialOf({{"emissiveFactor", {0.5, 0.25, 1}}, {"extensions", extensions}});
  EXPECT_EQ(m.emission.radiance, (Vec3{0.5f, 0.25f, 1}));
  EXPECT_EQ(m.ior, 1.5f);
  EXPECT_EQ(m.specular.factor, 1);
  EXPECT_EQ(m.specular.color, (Vec3{1, 1, 1}));
  EXPECT_EQ(m.transmission.factor, 0);
  EXPECT_FALSE(m.volume.is_solid);
  EXPECT_EQ(m.volume.attenuation_color, (Vec3{1, 1, 1}));
  EXPECT_EQ(m.volume.dispersion, 0);
  EXPECT_EQ(m.clearcoat.factor, 0);
  EXPECT_EQ(m.clearcoat.roughness, 0);
  EXPECT_EQ(m.sheen.color, (Vec3{0, 0, 0}));
  EXPECT_EQ(m.sheen.roughness, 0);
  EXPECT_EQ(m.base.anisotropy.strength, 0);
  EXPECT_EQ(m.base.diffuse_transmission.factor, 0);
  EXPECT_EQ(m.iridescence.factor, 0);
  extensions["KHR_materials_diffuse_transmission"] = {{"diffuseTransmissionFactor", 1}};
  extensions["KHR_materials_iridescence"] = {{"iridescenceFactor", 1}};
  extensions["KHR_materials_anisotropy"] = {{"anisotropyStrength", 1}};
  extensions["KHR_materials_clearcoat"] = {{"clearcoatNormalTexture", {{"index", 0}}},
                                           {"clearcoatFactor", 1}};
  extensions["KHR_materials_pbrSpecularGlossiness"] = json::object();
  const Material with_factors = MaterialOf({{"extensions", extensions}});
  EXPECT_EQ(with_factors.base.diffuse_transmission.color, (Vec3{1, 1, 1}));
  EXPECT_EQ(with_factors.iridescence.ior, 1.3f);
  EXPECT_EQ(with_factors.iridescence.min_thickness_nm, 100);
  EXPECT_EQ(with_factors.iridescence.max_thickness_nm, 400);
  EXPECT_EQ(with_factors.base.anisotropy.direction.x, 1);
  EXPECT_EQ(with_factors.base.anisotropy.direction.y, 0);
  EXPECT_EQ(with_factors.clearcoat.normal_map.scale, 1);
  EXPECT_EQ(with_factors.base.color, (Vec3{1, 1, 1}));
  EXPECT_EQ(with_factors.base.alpha, 1);
  EXPECT_EQ(with_factors.base.metallic, 0);
  EXPECT_EQ(with_factors.base.roughness, 0) << "glossiness is 1";
  EXPECT_EQ(with_factors.specular.color, (Vec3{1, 1, 1}));
}

TEST(Materials, ReadMetallicRoughness) {
  const Material m = MaterialOf({{"name", "Brass"},
                                 {"doubleSided", true},
                                 {"alphaMode", "MASK"},
                                 {"alphaCutoff", 0.25},
                                 {"normalTexture", {{"index", 0}, {"scale", 0.5}, {"texCoord", 1}}},
                                 {"pbrMetallicRoughness",
                                  {{"baseColorFactor", {0.1, 0.2, 0.3, 0.4}},
                                   {"baseColorTexture", {{"index", 0}}},
                                   {"metallicFactor", 0.5},
                                   {"roughnessFactor", 0.75},
                                   {"metallicRoughnessTexture", {{"index", 0}}}}}});
  EXPECT_EQ(m.name, "Brass");
  EXPECT_TRUE(m.double_sided);
  EXPECT_EQ(m.alpha_mode, AlphaMode::kMask);
  EXPECT_EQ(m.alpha_cutoff, 0.25f);
  EXPECT_EQ(m.base.color, (Vec3{0.1f, 0.2f, 0.3f}));
  EXPECT_EQ(m.base.alpha, 0.4f);
  EXPECT_EQ(m.base.metallic, 0.5f);
  EXPECT_EQ(m.base.roughness, 0.75f);
  EXPECT_EQ(m.base.color_texture.texture, 0);
  EXPECT_EQ(m.base.metallic_roughness_texture.texture, 0);
  EXPECT_EQ(m.normal_map.texture.texture, 0);
  EXPECT_EQ(m.normal_map.texture.uv_set, 1);
  EXPECT_EQ(m.normal_map.scale, 0.5f);
}

TEST(Materials, ReadExtensions) {
  const Material m = MaterialOf(
      {{"emissiveFactor", {1, 0.5, 0}},
       {"alphaMode", "BLEND"},
       {"extensions",
        {{"KHR_materials_emissive_strength", {{"emissiveStrength", 20}}},
         {"KHR_materials_ior", {{"ior", 1.33}}},
         {"KHR_materials_specular", {{"specularFactor", 0.25}, {"specularColorFactor", {1, 0.5, 2}}}},
         {"KHR_materials_transmission", {{"transmissionFactor", 1}}},
         {"KHR_materials_unlit", json::object()},
         {"KHR_materials_volume",
          {{"thicknessFactor", 0.1},
           {"attenuationDistance", 2.5},
           {"attenuationColor", {0.9, 0.8, 0.7}}}}}}});
  EXPECT_EQ(m.emission.radiance, (Vec3{20, 10, 0}));
  EXPECT_EQ(m.alpha_mode, AlphaMode::kBlend);
  EXPECT_EQ(m.ior, 1.33f);
  EXPECT_EQ(m.specular.factor, 0.25f);
  EXPECT_EQ(m.specular.color, (Vec3{1, 0.5f, 2}));
  EXPECT_EQ(m.transmission.factor, 1);
  EXPECT_TRUE(m.unlit);
  EXPECT_TRUE(m.volume.is_solid);
  EXPECT_EQ(m.volume.attenuation_distance, 2.5f);
  EXPECT_EQ(m.volume.attenuation_color, (Vec3{0.9f, 0.8f, 0.7f}));
}

TEST(Materials, AreThinWithoutThickness) {
  EXPECT_FALSE(
      MaterialOf({{"extensions", {{"KHR_materials_volume", {{"thicknessFactor", 0}}}}}}).volume.is_solid);
}

TEST(Materials, ClampFactorsAndCountIt) {
  const Scene scene =
      MustLoad(WithMaterial({{"pbrMetallicRoughness", {{"roughnessFactor", 1.5}, {"metallicFactor", -1}}},
                             {"emissiveFactor", {-1, 0, 0}}}));
  EXPECT_EQ(scene.materials[0].base.roughness, 1);
  EXPECT_EQ(scene.materials[0].base.metallic, 0);
  EXPECT_EQ(scene.materials[0].emission.radiance.x, 0);
  EXPECT_THAT(scene.warnings,
              Contains("values of roughnessFactor outside 0 to 1 clamped: 1 (the first in material 0)"));
}

TEST(Materials, TakeTheLimitsOfTheirFactors) {
  const auto with = [](const char* extension, const char* field, double value) {
    return MaterialOf({{"extensions", {{extension, {{field, value}}}}}});
  };
  EXPECT_EQ(with("KHR_materials_ior", "ior", 1).ior, 1);
  EXPECT_EQ(with("KHR_materials_ior", "ior", 0.9).ior, 1);
  EXPECT_EQ(with("KHR_materials_ior", "ior", 1000.5).ior, 1000);
  EXPECT_GT(with("KHR_materials_ior", "ior", 0).ior, 1e5f) << "all is reflected";
  EXPECT_FALSE(with("KHR_materials_volume", "thicknessFactor", 0).volume.is_solid);
  EXPECT_TRUE(with("KHR_materials_volume", "thicknessFactor", 1e-6).volume.is_solid);
  EXPECT_EQ(with("KHR_materials_transmission", "transmissionFactor", 1.5).transmission.factor, 1);
}

TEST(Materials, TransformTextureCoordinates) {
  const Material m = MaterialOf({{"pbrMetallicRoughness",
                                  {{"baseColorTexture",
                                    {{"index", 0},
                                     {"extensions",
                                      {{"KHR_texture_transform",
                                        {{"offset", {0.5, 0.25}},
                                         {"scale", {2, 3}},
                                         {"rotation", 1.5707963267948966},
                                         {"texCoord", 1}}}}}}}}}});
  const TextureRef& ref = m.base.color_texture;
  EXPECT_EQ(ref.uv_set, 1);
  // A rotation by 90 degrees counter-clockwise, with v down, maps +u to -v and +v to +u.
  EXPECT_NEAR(ref.row_u.x, 0, 1e-6);
  EXPECT_NEAR(ref.row_u.y, 3, 1e-5);
  EXPECT_NEAR(ref.row_v.x, -2, 1e-5);
  EXPECT_NEAR(ref.row_v.y, 0, 1e-6);
  EXPECT_EQ(ref.offset.x, 0.5f);
  EXPECT_EQ(ref.offset.y, 0.25f);
}

TEST(Materials, DecodeASharedImageOnce) {
  GltfFixture fixture = WithMaterial({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 1}}}}},
                                      {"emissiveFactor", {1, 1, 1}},
                                      {"emissiveTexture", {{"index", 0}}}});
  fixture.Add("samplers", {{"wrapS", 33071}, {"wrapT", 33648}, {"magFilter", 9728}});
  fixture.Add("textures", {{"source", 0}, {"sampler", 0}});
  const Scene scene = MustLoad(fixture);
  ASSERT_EQ(scene.images.size(), 1u);
  EXPECT_EQ(scene.images[0]->width, 2);
  EXPECT_EQ(scene.images[0]->rgba[0], 255);
  ASSERT_EQ(scene.textures.size(), 2u);
  const Texture& base = scene.textures[scene.materials[0].base.color_texture.texture];
  EXPECT_EQ(base.wrap_s, Wrap::kClamp);
  EXPECT_EQ(base.wrap_t, Wrap::kMirror);
  EXPECT_TRUE(base.nearest);
  const Texture& emission = scene.textures[scene.materials[0].emission.texture.texture];
  EXPECT_EQ(emission.wrap_s, Wrap::kRepeat);
  EXPECT_FALSE(emission.nearest);
}

TEST(Materials, DoNotDecodeUnusedTextures) {
  GltfFixture fixture = WithMaterial(json::object());
  fixture.json["images"][0] = {{"uri", "missing.png"}};
  const Scene scene = MustLoad(fixture);
  EXPECT_THAT(scene.images, IsEmpty());
}

TEST(Materials, NameTheImageThatDoesNotDecode) {
  GltfFixture fixture = WithMaterial({{"name", "Flag"}, {"normalTexture", {{"index", 0}}}});
  fixture.json["images"][0]["bufferView"] = fixture.AddView("GIF89a");
  EXPECT_EQ(ErrorOf(fixture), "test.glb: image 0 \"flag\": neither PNG, JPEG, WebP nor KTX2");
}

TEST(Materials, RefuseTexturesThatDoNotExist) {
  const json material = {{"normalTexture", {{"index", 0}}}};
  EXPECT_THAT(ErrorOf(WithMaterial({{"normalTexture", {{"index", 4}}}})),
              HasSubstr("material 0: texture 4 does not exist (there are 1)"));
  GltfFixture image = WithMaterial(material);
  image.json["textures"][0]["source"] = 2;
  EXPECT_THAT(ErrorOf(image), HasSubstr("texture 0: image 2 does not exist (there are 1)"));
  GltfFixture sampler = WithMaterial(material);
  sampler.json["textures"][0]["sampler"] = 0;
  EXPECT_THAT(ErrorOf(sampler), HasSubstr("texture 0: sampler 0 does not exist (there are 0)"));
  sampler.Add("samplers", {{"wrapS", 5}});
  EXPECT_THAT(ErrorOf(sampler), HasSubstr("texture 0: wrap mode 5 is not glTF's"));
  GltfFixture view = WithMaterial(material);
  view.json["images"][0]["bufferView"] = -7;
  EXPECT_THAT(ErrorOf(view), HasSubstr("image 0 \"flag\": buffer view -7 does not exist"));
  view.json["images"][0].erase("bufferView");
  EXPECT_THAT(ErrorOf(view), HasSubstr("image 0 \"flag\": needs either a uri or a bufferView"));
}

TEST(Materials, CountTexturesOfAllImagesAgainstTheLimit) {
  const GltfFixture fixture = WithMaterial({{"normalTexture", {{"index", 0}}}});
  LoadOptions options;
  options.limits.max_texture_pixels = 2;
  EXPECT_TRUE(fixture.Load(options).ok());
  options.limits.max_texture_pixels = 1;
  EXPECT_EQ(fixture.Load(options).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(Materials, OfSpecularAndGlossinessReflectTheirColourAtAllAngles) {
  const json values = {{"diffuseFactor", {0.5, 0.25, 0, 0.75}},
                       {"specularFactor", {0.1, 0.2, 0.3}},
                       {"glossinessFactor", 0.75}};
  const Material m = MaterialOf({{"extensions", {{"KHR_materials_pbrSpecularGlossiness", values}}},
                                 {"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 1, 1}}}}});
  EXPECT_EQ(m.base.color, (Vec3{0.5f, 0.25f, 0}));
  EXPECT_EQ(m.base.alpha, 0.75f);
  EXPECT_EQ(m.base.metallic, 0);
  EXPECT_EQ(m.base.roughness, 0.25f);
  EXPECT_EQ(m.specular.color, (Vec3{0.1f, 0.2f, 0.3f}));
  const float r = (m.ior - 1) / (m.ior + 1);
  EXPECT_NEAR(r * r, 1, 1e-5);
}

TEST(Materials, OfSpecularAndGlossinessHaveTheRoughnessOfTheirAlpha) {
  const json values = {{"specularGlossinessTexture", {{"index", 0}}}, {"glossinessFactor", 0.5}};
  GltfFixture fixture = WithMaterial({{"extensions", {{"KHR_materials_pbrSpecularGlossiness", values}}}});
  fixture.json["images"][0]["bufferView"] =
      fixture.AddView(EncodePng(2, 1, 4, 8, false, {9, 8, 7, 255, 9, 8, 7, 0}));
  const Scene scene = MustLoad(fixture);
  const Material& m = scene.materials[0];
  const auto image_of = [&](const TextureRef& ref) {
    return scene.images[scene.textures[ref.texture].image];
  };
  EXPECT_THAT(image_of(m.specular.color_texture)->rgba, testing::ElementsAre(9, 8, 7, 255, 9, 8, 7, 0));
  EXPECT_THAT(image_of(m.base.metallic_roughness_texture)->rgba,
              testing::ElementsAre(0, 128, 0, 255, 0, 255, 0, 255));
  EXPECT_EQ(m.base.roughness, 1);
}

TEST(Materials, TakeThePictureOfAnExtensionBeforeThePlainOne) {
  GltfFixture fixture = WithMaterial({{"normalTexture", {{"index", 0}}}});
  fixture.Add("images", {{"bufferView", fixture.AddView(EncodePng(1, 1, 1, 8, false, {5}))}});
  fixture.json["textures"][0]["extensions"]["EXT_texture_webp"] = {{"source", 1}};
  EXPECT_EQ(MustLoad(fixture).images[0]->width, 1);
  fixture.json["textures"][0].erase("source");
  EXPECT_EQ(MustLoad(fixture).images[0]->width, 1);
}

TEST(Materials, AreTheSameForAnyNumberOfThreads) {
  GltfFixture fixture = WithMaterial({{"normalTexture", {{"index", 0}}}});
  for (int i = 1; i < 9; ++i) {
    const auto level = static_cast<uint8_t>(i);
    fixture.Add("images",
                {{"bufferView", fixture.AddView(EncodePng(i, 1, 1, 8, false, std::vector(i, level)))}});
    fixture.Add("textures", {{"source", i}});
    fixture.Add("materials", {{"normalTexture", {{"index", i}}}});
  }
  const auto pool = MakeTaskPool(4);
  LoadOptions options;
  options.pool = pool.get();
  const auto scene = fixture.Load(options);
  ASSERT_TRUE(scene.ok()) << scene.status();
  const Scene alone = MustLoad(fixture);
  ASSERT_EQ(scene->images.size(), 9u);
  for (size_t i = 0; i < 9; ++i) EXPECT_EQ(scene->images[i]->rgba, alone.images[i]->rgba);
  for (const int broken : {7, 3}) fixture.json["images"][broken]["bufferView"] = fixture.AddView("GIF");
  EXPECT_EQ(fixture.Load(options).status().message(), "test.glb: image 3: neither PNG, JPEG, WebP nor KTX2");
}

TEST(Materials, RefuseMalformedValues) {
  EXPECT_THAT(ErrorOf(WithMaterial({{"alphaMode", "SHINY"}})), HasSubstr("material 0: alphaMode \"SHINY\""));
  EXPECT_THAT(ErrorOf(WithMaterial({{"extensions", {{"KHR_materials_ior", {{"ior", "glass"}}}}}})),
              HasSubstr("material 0: ior is not a number"));
  EXPECT_THAT(ErrorOf(WithMaterial(
                  {{"extensions", {{"KHR_materials_specular", {{"specularColorFactor", {1, 2}}}}}}})),
              HasSubstr("material 0: specularColorFactor is not an array of 3 numbers"));
  EXPECT_THAT(ErrorOf(WithMaterial({{"normalTexture", {{"index", 0}, {"scale", 1e300}}}})),
              HasSubstr("material 0: normalTexture.scale is not finite"));
  EXPECT_THAT(ErrorOf(WithMaterial({{"pbrMetallicRoughness", {{"baseColorFactor", {1, 2}}}}})),
              HasSubstr("baseColorFactor"));
}

TEST(Materials, ReadCoatAndSheen) {
  const Material m = MaterialOf({{"extensions",
                                  {{"KHR_materials_clearcoat",
                                    {{"clearcoatFactor", 0.5},
                                     {"clearcoatTexture", {{"index", 0}, {"texCoord", 1}}},
                                     {"clearcoatRoughnessFactor", 0.25},
                                     {"clearcoatRoughnessTexture", {{"index", 0}}},
                                     {"clearcoatNormalTexture", {{"index", 0}, {"scale", 0.5}}}}},
                                   {"KHR_materials_sheen",
                                    {{"sheenColorFactor", {0.1, 0.2, 0.3}},
                                     {"sheenColorTexture", {{"index", 0}}},
                                     {"sheenRoughnessFactor", 0.75},
                                     {"sheenRoughnessTexture", {{"index", 0}}}}}}}});
  EXPECT_EQ(m.clearcoat.factor, 0.5f);
  EXPECT_EQ(m.clearcoat.factor_texture.texture, 0);
  EXPECT_EQ(m.clearcoat.factor_texture.uv_set, 1);
  EXPECT_EQ(m.clearcoat.roughness, 0.25f);
  EXPECT_EQ(m.clearcoat.roughness_texture.texture, 0);
  EXPECT_EQ(m.clearcoat.normal_map.texture.texture, 0);
  EXPECT_EQ(m.clearcoat.normal_map.scale, 0.5f);
  EXPECT_EQ(m.sheen.color, (Vec3{0.1f, 0.2f, 0.3f}));
  EXPECT_EQ(m.sheen.color_texture.texture, 0);
  EXPECT_EQ(m.sheen.roughness, 0.75f);
  EXPECT_EQ(m.sheen.roughness_texture.texture, 0);
}

TEST(Materials, ReadAnisotropy) {
  const Material m = MaterialOf({{"extensions",
                                  {{"KHR_materials_anisotropy",
                                    {{"anisotropyStrength", 0.75},
                                     {"anisotropyRotation", 0.5},
                                     {"anisotropyTexture", {{"index", 0}, {"texCoord", 1}}}}}}}});
  EXPECT_EQ(m.base.anisotropy.strength, 0.75f);
  EXPECT_NEAR(m.base.anisotropy.direction.x, std::cos(0.5f), 1e-6f);
  EXPECT_NEAR(m.base.anisotropy.direction.y, std::sin(0.5f), 1e-6f);
  EXPECT_EQ(m.base.anisotropy.texture.texture, 0);
  EXPECT_EQ(m.base.anisotropy.texture.uv_set, 1);
}

TEST(Materials, ReadDiffuseTransmission) {
  const Material m =
      MaterialOf({{"extensions",
                   {{"KHR_materials_diffuse_transmission",
                     {{"diffuseTransmissionFactor", 0.25},
                      {"diffuseTransmissionTexture", {{"index", 0}}},
                      {"diffuseTransmissionColorFactor", {1, 0.5, 0.25}},
                      {"diffuseTransmissionColorTexture", {{"index", 0}, {"texCoord", 1}}}}}}}});
  EXPECT_EQ(m.base.diffuse_transmission.factor, 0.25f);
  EXPECT_EQ(m.base.diffuse_transmission.factor_texture.texture, 0);
  EXPECT_EQ(m.base.diffuse_transmission.color, (Vec3{1, 0.5f, 0.25f}));
  EXPECT_EQ(m.base.diffuse_transmission.color_texture.texture, 0);
  EXPECT_EQ(m.base.diffuse_transmission.color_texture.uv_set, 1);
}

TEST(Materials, ReadIridescence) {
  const Material m = MaterialOf({{"extensions",
                                  {{"KHR_materials_iridescence",
                                    {{"iridescenceFactor", 0.75},
                                     {"iridescenceTexture", {{"index", 0}}},
                                     {"iridescenceIor", 1.8},
                                     {"iridescenceThicknessMinimum", 200},
                                     {"iridescenceThicknessMaximum", 800},
                                     {"iridescenceThicknessTexture", {{"index", 0}, {"texCoord", 1}}}}}}}});
  EXPECT_EQ(m.iridescence.factor, 0.75f);
  EXPECT_EQ(m.iridescence.factor_texture.texture, 0);
  EXPECT_EQ(m.iridescence.ior, 1.8f);
  EXPECT_EQ(m.iridescence.min_thickness_nm, 200);
  EXPECT_EQ(m.iridescence.max_thickness_nm, 800);
  EXPECT_EQ(m.iridescence.thickness_texture.uv_set, 1);
}

TEST(Materials, OnlySolidGlassDisperses) {
  json extensions = {{"KHR_materials_dispersion", {{"dispersion", 0.5}}},
                     {"KHR_materials_transmission", {{"transmissionFactor", 1}}},
                     {"KHR_materials_volume", {{"thicknessFactor", 1}}}};
  EXPECT_EQ(MaterialOf({{"extensions", extensions}}).volume.dispersion, 0.5f);
  extensions["KHR_materials_volume"]["thicknessFactor"] = 0;
  EXPECT_EQ(MaterialOf({{"extensions", extensions}}).volume.dispersion, 0);
  extensions.erase("KHR_materials_transmission");
  extensions["KHR_materials_volume"]["thicknessFactor"] = 1;
  EXPECT_EQ(MaterialOf({{"extensions", extensions}}).volume.dispersion, 0);
}

TEST(Materials, ReadTexturesOfExtensions) {
  const Material m = MaterialOf(
      {{"extensions",
        {{"KHR_materials_specular",
          {{"specularTexture",
            {{"index", 0}, {"extensions", {{"KHR_texture_transform", {{"offset", {0.5, 0.25}}}}}}}},
           {"specularColorTexture", {{"index", 0}}}}},
         {"KHR_materials_transmission",
          {{"transmissionFactor", 1}, {"transmissionTexture", {{"index", 0}}}}}}}});
  EXPECT_EQ(m.specular.factor_texture.texture, 0);
  EXPECT_EQ(m.specular.factor_texture.offset.x, 0.5f);
  EXPECT_EQ(m.specular.factor_texture.offset.y, 0.25f);
  EXPECT_EQ(m.specular.color_texture.texture, 0);
  EXPECT_EQ(m.transmission.texture.texture, 0);
}

TEST(Materials, RefuseMalformedTexturesOfExtensions) {
  for (const json& info : {json(7), json{{"index", -1}}, json{{"index", "zero"}}}) {
    const auto fixture =
        WithMaterial({{"extensions", {{"KHR_materials_specular", {{"specularTexture", info}}}}}});
    EXPECT_THAT(ErrorOf(fixture), HasSubstr("material 0: ")) << info;
  }
}

TEST(Materials, DoNotDecodeTexturesOfFactorZero) {
  const Scene scene =
      MustLoad(WithMaterial({{"extensions",
                              {{"KHR_materials_anisotropy", {{"anisotropyTexture", {{"index", 0}}}}},
                               {"KHR_materials_clearcoat", {{"clearcoatTexture", {{"index", 0}}}}},
                               {"KHR_materials_sheen", {{"sheenColorTexture", {{"index", 0}}}}},
                               {"KHR_materials_transmission", {{"transmissionTexture", {{"index", 0}}}}}}}}));
  EXPECT_THAT(scene.images, IsEmpty());
}

TEST(Materials, CountTexturesThatTheRendererDoesNotUse) {
  const Scene scene = MustLoad(
      WithMaterial({{"normalTexture", {{"index", 0}, {"texCoord", 3}}},
                    {"extensions", {{"KHR_materials_volume", {{"thicknessTexture", {{"index", 0}}}}}}}}));
  EXPECT_EQ(scene.materials[0].normal_map.texture.uv_set, 0);
  EXPECT_THAT(
      scene.warnings,
      Contains(
          "thicknessTexture is not supported: the shape itself is what light goes through: 1 (the first in "
          "material 0)"));
  EXPECT_THAT(
      scene.warnings,
      Contains("textures that want another UV set than 0 or 1 use set 0: 1 (the first in material 0)"));
}

}  // namespace
}  // namespace lumifold::scene
