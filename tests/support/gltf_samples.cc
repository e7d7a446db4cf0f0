#include "tests/support/gltf_samples.h"

#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include "filter/image/check.h"

namespace lumifold::scene {
namespace {

/// An animation of one channel.
void AddAnimation(int node, const char* path, const char* interpolation, int times, int values,
                  GltfFixture* fixture) {
  fixture->Add("animations",
               {{"channels", {{{"sampler", 0}, {"target", {{"node", node}, {"path", path}}}}}},
                {"samplers", {{{"input", times}, {"output", values}, {"interpolation", interpolation}}}}});
}

/// Two triangles of the unit square with texture coordinates; attribute 0 is the position, 1 the coordinates.
std::string EncodeDracoSquare(bool edgebreaker) {
  const float corners[4][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int uv = builder.AddAttribute(draco::GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32);
  builder.SetAttributeValuesForFace(position, draco::FaceIndex(0), corners[0], corners[1], corners[2]);
  builder.SetAttributeValuesForFace(position, draco::FaceIndex(1), corners[0], corners[2], corners[3]);
  builder.SetAttributeValuesForFace(uv, draco::FaceIndex(0), corners[0], corners[1], corners[2]);
  builder.SetAttributeValuesForFace(uv, draco::FaceIndex(1), corners[0], corners[2], corners[3]);
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetEncodingMethod(edgebreaker ? draco::MESH_EDGEBREAKER_ENCODING : draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer buffer;
  LUMIFOLD_CHECK(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  return {buffer.data(), buffer.size()};
}

}  // namespace

GltfFixture FurnishedDocument() {
  GltfFixture fixture;
  const std::vector<uint8_t> pixels(4 * 4 * 3, 128);
  fixture.Add("images", {{"bufferView", fixture.AddView(EncodePng(4, 4, 3, 8, false, pixels))}});
  fixture.Add("images", {{"bufferView", fixture.AddView(EncodeJpeg(4, 4, 3, false, pixels))}});
  fixture.Add("samplers", {{"wrapS", 33071}});
  fixture.Add("textures", {{"source", 0}, {"sampler", 0}});
  fixture.Add("textures", {{"source", 1}});
  fixture.Add("materials",
              {{"emissiveFactor", {1, 1, 1}},
               {"normalTexture", {{"index", 1}}},
               {"pbrMetallicRoughness",
                {{"baseColorTexture",
                  {{"index", 0}, {"extensions", {{"KHR_texture_transform", {{"offset", {0.5, 0}}}}}}}}}},
               {"extensions",
                {{"KHR_materials_ior", {{"ior", 1.3}}},
                 {"KHR_materials_iridescence",
                  {{"iridescenceFactor", 1}, {"iridescenceThicknessTexture", {{"index", 1}}}}},
                 {"KHR_materials_diffuse_transmission",
                  {{"diffuseTransmissionFactor", 0.5}, {"diffuseTransmissionColorTexture", {{"index", 0}}}}},
                 {"KHR_materials_anisotropy",
                  {{"anisotropyStrength", 0.5}, {"anisotropyTexture", {{"index", 1}}}}}}}});
  const int normals = fixture.AddShorts({0, 0, 32767, 0, 0, 32767, 0, 0, 32767}, "VEC3", true);
  const int uvs = fixture.AddFloats({0, 0, 1, 0, 0, 1}, "VEC2");
  const int indices = fixture.AddIndices({0, 1, 2});
  fixture.AddTriangles(
      kTriangle,
      {{"indices", indices}, {"material", 0}, {"attributes", {{"NORMAL", normals}, {"TEXCOORD_0", uvs}}}});
  const int translations = fixture.AddFloats({1, 0, 0, 2, 0, 0}, "VEC3");
  fixture.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] =
      translations;
  fixture.Add("cameras", {{"type", "perspective"}, {"perspective", {{"yfov", 0.5}, {"znear", 0.1}}}});
  fixture.AddNode({{"camera", 0}, {"children", {0}}, {"rotation", {0, 0, 0, 1}}});
  fixture.Add("scenes", {{"nodes", {1}}});
  return fixture;
}

GltfFixture SkinnedDocument() {
  GltfFixture fixture;
  const int joints = fixture.AddBytes({0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4", false);
  const int weights = fixture.AddFloats({1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  const int normals = fixture.AddFloats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  const int indices = fixture.AddIndices({0, 1, 2, 0, 2, 3});
  fixture.AddTriangles({0, 0, 0, 1, 0, 0, 1, 2, 0, 0, 2, 0},
                       {{"indices", indices},
                        {"attributes", {{"JOINTS_0", joints}, {"WEIGHTS_0", weights}, {"NORMAL", normals}}}});
  const int bind = fixture.AddFloats(
      {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1},
      "MAT4");
  fixture.json["nodes"][0]["skin"] = 0;
  fixture.json["nodes"][0]["translation"] = {7, 7, 7};  // must be ignored
  const int upper = fixture.AddNode({{"translation", {0, 1, 0}}});
  const int lower = fixture.AddNode({{"children", {upper}}});
  fixture.Add("skins", {{"joints", {lower, upper}}, {"inverseBindMatrices", bind}});
  const int times = fixture.AddFloats({0, 1}, "SCALAR");
  const int turns = fixture.AddFloats({0, 0, 0, 1, 0, 0, 0.70710678f, 0.70710678f}, "VEC4");
  AddAnimation(upper, "rotation", "LINEAR", times, turns, &fixture);
  return fixture;
}

GltfFixture MorphedDocument() {
  GltfFixture fixture;
  const int first = fixture.AddFloats({0, 0, 0, 1, 0, 0, 0, 0, 0}, "VEC3");
  const int second = fixture.AddFloats({0, 0, 0, 0, 0, 0, 0, 1, 0}, "VEC3");
  fixture.AddTriangles(kTriangle, {{"targets", {{{"POSITION", first}}, {{"POSITION", second}}}}});
  fixture.json["meshes"][0]["weights"] = {0, 0};
  const int times = fixture.AddFloats({0, 2}, "SCALAR");
  const int weights = fixture.AddFloats({0, 0, 1, 0.5f}, "SCALAR");
  AddAnimation(0, "weights", "LINEAR", times, weights, &fixture);
  return fixture;
}

GltfFixture DracoDocument(bool edgebreaker) {
  GltfFixture fixture;
  const int view = fixture.AddView(EncodeDracoSquare(edgebreaker));
  const int position = fixture.Add("accessors", {{"componentType", 5126}, {"count", 4}, {"type", "VEC3"}});
  const int uv = fixture.Add("accessors", {{"componentType", 5126}, {"count", 4}, {"type", "VEC2"}});
  const int indices = fixture.Add("accessors", {{"componentType", 5125}, {"count", 6}, {"type", "SCALAR"}});
  const int mesh =
      fixture.AddMesh({{"attributes", {{"POSITION", position}, {"TEXCOORD_0", uv}}},
                       {"indices", indices},
                       {"extensions",
                        {{"KHR_draco_mesh_compression",
                          {{"bufferView", view}, {"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}}}}}}}});
  fixture.AddNode({{"mesh", mesh}});
  fixture.json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  fixture.json["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  return fixture;
}

GltfFixture LitDocument() {
  GltfFixture fixture;
  fixture.Add(
      "materials",
      {{"extensions",
        {{"KHR_materials_clearcoat", {{"clearcoatFactor", 0.5}, {"clearcoatRoughnessFactor", 0.25}}},
         {"KHR_materials_dispersion", {{"dispersion", 0.4}}},
         {"KHR_materials_transmission", {{"transmissionFactor", 0.5}}},
         {"KHR_materials_volume", {{"thicknessFactor", 1}}},
         {"KHR_materials_sheen", {{"sheenColorFactor", {0.1, 0.2, 0.3}}, {"sheenRoughnessFactor", 0.4}}}}}});
  fixture.AddTriangles(kTriangle, {{"material", 0}});
  auto& lights = fixture.json["extensions"]["KHR_lights_punctual"]["lights"];
  lights.push_back({{"type", "point"}, {"intensity", 40}, {"color", {1, 0.5, 0.25}}, {"range", 12}});
  lights.push_back(
      {{"type", "spot"}, {"name", "lamp"}, {"spot", {{"innerConeAngle", 0.2}, {"outerConeAngle", 0.5}}}});
  lights.push_back({{"type", "directional"}, {"intensity", 3}});
  for (int light = 0; light < 3; ++light) {
    fixture.AddNode({{"translation", {0, light, 0}},
                     {"scale", {2, 2, 2}},
                     {"extensions", {{"KHR_lights_punctual", {{"light", light}}}}}});
  }
  fixture.json["extensionsUsed"] = {"KHR_lights_punctual", "KHR_materials_clearcoat", "KHR_materials_sheen"};
  return fixture;
}

std::vector<NamedDocument> SampleDocuments() {
  return {{"furnished", FurnishedDocument()},
          {"skinned", SkinnedDocument()},
          {"morphed", MorphedDocument()},
          {"draco-sequential", DracoDocument(false)},
          {"draco-edgebreaker", DracoDocument(true)},
          {"lit", LitDocument()}};
}

}  // namespace lumifold::scene
