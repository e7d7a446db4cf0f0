#include "tests/support/gltf_fixture.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
// jpeglib.h needs size_t and FILE of the headers above.
#include <jpeglib.h>
#include <png.h>

#include "filter/image/check.h"

template class nlohmann::basic_json<>;

namespace lumifold::scene {
namespace {

template <typename T>
std::string_view BytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

size_t Width(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "MAT4") return 16;
  LUMIFOLD_CHECK(type.size() == 4 && type.starts_with("VEC"));
  return static_cast<size_t>(type[3] - '0');
}

void AppendLittleEndian(std::string* out, uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out->push_back(static_cast<char>(value >> shift & 0xff));
}

void AppendChunk(std::string* out, uint32_t type, const std::string& content) {
  AppendLittleEndian(out, static_cast<uint32_t>(content.size()));
  AppendLittleEndian(out, type);
  out->append(content);
}

}  // namespace

int GltfFixture::Add(const char* section, const nlohmann::json& object) {
  json[section].push_back(object);
  return static_cast<int>(json[section].size()) - 1;
}

int GltfFixture::AddView(std::string_view bytes, int stride) {
  binary.resize((binary.size() + 3) / 4 * 4);
  nlohmann::json view = {{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", bytes.size()}};
  if (stride != 0) view["byteStride"] = stride;
  binary.append(bytes);
  return Add("bufferViews", view);
}

int GltfFixture::AddAccessor(std::string_view bytes, int component_type, size_t count,
                             const std::string& type, bool normalized) {
  const int view = AddView(bytes);
  return Add("accessors", {{"bufferView", view},
                           {"componentType", component_type},
                           {"count", count},
                           {"type", type},
                           {"normalized", normalized}});
}

int GltfFixture::AddFloats(const std::vector<float>& values, const std::string& type) {
  return AddAccessor(BytesOf(values), 5126, values.size() / Width(type), type, false);
}

int GltfFixture::AddBytes(const std::vector<uint8_t>& values, const std::string& type, bool normalized) {
  return AddAccessor(BytesOf(values), 5121, values.size() / Width(type), type, normalized);
}

int GltfFixture::AddShorts(const std::vector<int16_t>& values, const std::string& type, bool normalized) {
  return AddAccessor(BytesOf(values), 5122, values.size() / Width(type), type, normalized);
}

int GltfFixture::AddIndices(const std::vector<uint32_t>& values) {
  return AddAccessor(BytesOf(values), 5125, values.size(), "SCALAR", false);
}

int GltfFixture::AddMesh(const nlohmann::json& primitive) {
  return Add("meshes", {{"primitives", nlohmann::json::array({primitive})}});
}

int GltfFixture::AddNode(const nlohmann::json& node) { return Add("nodes", node); }

int GltfFixture::AddTriangles(const std::vector<float>& positions, const nlohmann::json& primitive) {
  nlohmann::json full = primitive;
  full["attributes"]["POSITION"] = AddFloats(positions, "VEC3");
  const int mesh = AddMesh(full);
  AddNode({{"mesh", mesh}});
  return mesh;
}

nlohmann::json GltfFixture::FullJson() const {
  nlohmann::json full = json;
  if (!binary.empty() && !full.contains("buffers")) full["buffers"] = {{{"byteLength", binary.size()}}};
  return full;
}

std::string GltfFixture::Glb() const { return MakeGlb(FullJson().dump(), binary); }

std::string GltfFixture::Text(const std::string& uri) const {
  nlohmann::json full = json;
  full["buffers"] = {{{"byteLength", binary.size()}, {"uri", uri}}};
  return full.dump();
}

absl::StatusOr<Scene> GltfFixture::Load(const LoadOptions& options) const {
  return LoadGltf(Glb(), "test.glb", NoFiles, options);
}

std::string MakeGlb(std::string json, std::string binary) {
  json.resize((json.size() + 3) / 4 * 4, ' ');
  binary.resize((binary.size() + 3) / 4 * 4);
  std::string body;
  AppendChunk(&body, 0x4E4F534A, json);
  if (!binary.empty()) AppendChunk(&body, 0x004E4942, binary);
  std::string glb = "glTF";
  AppendLittleEndian(&glb, 2);
  AppendLittleEndian(&glb, static_cast<uint32_t>(12 + body.size()));
  return glb + body;
}

std::string EncodePng(int width, int height, int channels, int bits, bool interlaced,
                      const std::vector<uint8_t>& samples) {
  constexpr int kColorTypes[] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                                 PNG_COLOR_TYPE_RGBA};
  const size_t row_bytes = static_cast<size_t>(width * channels * bits / 8);
  LUMIFOLD_CHECK(samples.size() == row_bytes * static_cast<size_t>(height));
  std::string out;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  const auto append = [](png_structp p, png_bytep data, size_t size) {
    static_cast<std::string*>(png_get_io_ptr(p))->append(reinterpret_cast<const char*>(data), size);
  };
  png_set_write_fn(png, &out, append, nullptr);
  png_set_IHDR(png, info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), bits,
               kColorTypes[channels - 1], interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  std::vector<png_bytep> rows;
  for (int y = 0; y < height; ++y) {
    rows.push_back(const_cast<png_bytep>(samples.data()) + static_cast<size_t>(y) * row_bytes);
  }
  png_write_image(png, rows.data());
  png_write_end(png, nullptr);
  png_destroy_write_struct(&png, &info);
  return out;
}

std::string EncodeJpeg(int width, int height, int channels, bool progressive,
                       const std::vector<uint8_t>& samples) {
  LUMIFOLD_CHECK(samples.size() == static_cast<size_t>(width * height * channels));
  jpeg_compress_struct jpeg = {};
  jpeg_error_mgr errors = {};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* buffer = nullptr;
  unsigned long size = 0;  // NOLINT: libjpeg's type
  jpeg_mem_dest(&jpeg, &buffer, &size);
  jpeg.image_width = static_cast<JDIMENSION>(width);
  jpeg.image_height = static_cast<JDIMENSION>(height);
  jpeg.input_components = channels;
  jpeg.in_color_space = channels == 1 ? JCS_GRAYSCALE : channels == 3 ? JCS_RGB : JCS_CMYK;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 100, TRUE);
  if (progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  while (jpeg.next_scanline < jpeg.image_height) {
    JSAMPROW row =
        const_cast<JSAMPROW>(samples.data()) + static_cast<size_t>(jpeg.next_scanline) * width * channels;
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  std::string out(reinterpret_cast<const char*>(buffer), size);
  jpeg_destroy_compress(&jpeg);
  std::free(buffer);
  return out;
}

}  // namespace lumifold::scene
