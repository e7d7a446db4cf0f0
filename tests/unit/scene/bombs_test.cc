// Small files that claim to be huge: each is refused by its header, before memory is taken for what it
// claims.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <string>
#include <vector>

#include "tests/support/gltf_fixture.h"
#include "tests/support/gltf_samples.h"
#include "tests/support/peak_memory.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::scene {
namespace {

using testing::HasSubstr;

const int64_t kMostPixels = LoadLimits().max_texture_pixels;

std::string BigEndian(uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift);
  return bytes;
}

std::string Chunk(const std::string& type, const std::string& data) {
  const std::string body = type + data;
  const auto checksum = static_cast<uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size())));
  return BigEndian(static_cast<uint32_t>(data.size())) + body + BigEndian(checksum);
}

std::string Deflated(const std::string& data) {
  uLongf size = compressBound(data.size());
  std::string packed(size, '\0');
  EXPECT_EQ(compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
                      reinterpret_cast<const Bytef*>(data.data()), data.size(), 9),
            Z_OK);
  packed.resize(size);
  return packed;
}

/// A grey PNG of one byte a pixel that says it has this size.
std::string Png(uint32_t width, uint32_t height, const std::string& pixels) {
  const std::string header = BigEndian(width) + BigEndian(height) + std::string("\x08\0\0\0\0", 5);
  return "\x89PNG\r\n\x1a\n" + Chunk("IHDR", header) + Chunk("IDAT", Deflated(pixels)) + Chunk("IEND", "");
}

/// The error of a scene whose only texture is the picture.
std::string ErrorOfTexture(const std::string& picture) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle, {{"material", 0}});
  fixture.Add("images", {{"bufferView", fixture.AddView(picture)}, {"mimeType", "image/png"}});
  fixture.Add("textures", {{"source", 0}});
  fixture.Add("materials", {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  const absl::Status status = fixture.Load().status();
  return std::string(status.message());
}

TEST(Bombs, PngOfTenThousandMegapixels) {
  const std::string bomb = Png(100'000, 100'000, std::string(1 << 20, '\0'));
  const int64_t before = PeakMemoryBytes();
  EXPECT_EQ(DecodeImage(bomb, kMostPixels).status(),
            absl::ResourceExhaustedError("100000x100000 pixels are over the limit of 2147483648"));
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
}

TEST(Bombs, PngWhosePixelsAreMoreThanItsHeaderSays) {
  // 256 MiB of zeros behind a header of one pixel.
  const std::string bomb = Png(1, 1, std::string(size_t{256} << 20, '\0'));
  ASSERT_LT(bomb.size(), size_t{300'000});
  const int64_t before = PeakMemoryBytes();
  const absl::StatusOr<ImageData> image = DecodeImage(bomb, kMostPixels);
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
  if (image.ok()) {
    EXPECT_EQ(image->rgba.size(), 4u);
  }
}

TEST(Bombs, JpegOfFourThousandMegapixels) {
  std::string bomb = EncodeJpeg(8, 8, 3, false, std::vector<uint8_t>(192, 9));
  const size_t frame = bomb.find("\xff\xc0");
  ASSERT_NE(frame, std::string::npos);
  bomb.replace(frame + 5, 4, "\xff\xdc\xff\xdc");  // 65500x65500, the most that libjpeg takes
  const int64_t before = PeakMemoryBytes();
  EXPECT_EQ(DecodeImage(bomb, kMostPixels).status(),
            absl::ResourceExhaustedError("65500x65500 pixels are over the limit of 2147483648"));
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
}

TEST(Bombs, TexturesOfASceneTogether) {
  const std::string error = ErrorOfTexture(Png(100'000, 100'000, std::string(1 << 20, '\0')));
  EXPECT_THAT(error, HasSubstr("image 0"));
  EXPECT_THAT(error, HasSubstr("100000x100000 pixels are over the limit of 2147483648"));
}

TEST(Bombs, DracoOfManyTriangles) {
  GltfFixture fixture = DracoDocument(false);
  fixture.binary.replace(fixture.binary.find("DRACO") + 11, 1, "\xff\xff\xff\x7f");
  const int64_t before = PeakMemoryBytes();
  EXPECT_THAT(std::string(fixture.Load().status().message()),
              HasSubstr("claims 268435455 triangles, but has only"));
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
}

TEST(Bombs, AccessorsOfManyElements) {
  for (const bool sparse : {false, true}) {
    GltfFixture fixture;
    fixture.AddTriangles(kTriangle);
    nlohmann::json& accessor = fixture.json["accessors"][0];
    accessor.erase("bufferView");
    accessor["count"] = 500'000'000;
    if (sparse) {
      accessor["sparse"] = {{"count", 250'000'000},
                            {"indices", {{"bufferView", 0}, {"componentType", 5125}}},
                            {"values", {{"bufferView", 0}}}};
    }
    const int64_t before = PeakMemoryBytes();
    EXPECT_THAT(std::string(fixture.Load().status().message()),
                HasSubstr("accessor 0: 500000000 elements without a buffer view, over the limit of 4194304"));
    EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
  }
}

TEST(Bombs, SparsePartsOfManyElements) {
  GltfFixture fixture;
  fixture.AddTriangles(kTriangle);
  nlohmann::json& accessor = fixture.json["accessors"][0];
  accessor.erase("bufferView");
  accessor["count"] = 4'000'000;
  accessor["sparse"] = {{"count", 4'000'000},
                        {"indices", {{"bufferView", 0}, {"componentType", 5125}}},
                        {"values", {{"bufferView", 0}}}};
  const int64_t before = PeakMemoryBytes();
  EXPECT_THAT(std::string(fixture.Load().status().message()), HasSubstr("sparse indices: 4000000 elements"));
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes + 4'000'000 * 12);
}

}  // namespace
}  // namespace lumifold::scene
