#include "worker/scene/images/ktx2.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "filter/image/file_io.h"
#include "worker/scene/images/decode_image.h"

namespace lumifold::scene {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr int64_t kEnoughPixels = 1 << 16;

/// A file in the corpus of the fuzz target, and the picture that the reference transcoder makes of it.
struct Ktx2Sample {
  const char* name;
  int width, height;
  uint64_t hash;  // FNV-1a of the pixels
};

// Written by the reference encoder from generated pictures, except for every-mode: random blocks of each
// UASTC mode with each of its partitions.
constexpr Ktx2Sample kKtx2Samples[] = {
    {"etc1s-129x57", 129, 57, 0xb98fb0430222f1b3},
    {"etc1s-1x1", 1, 1, 0x296c2f53e561a9f5},
    {"etc1s-alpha-mipmaps-129x57", 129, 57, 0xc279a26f1f70dd81},
    {"etc1s-grey-64x48", 64, 48, 0x0a6f4d8c64b2d5e1},
    {"etc1s-one-colour-64x48", 64, 48, 0x5dfff6c278981b25},
    {"uastc-5x7", 5, 7, 0x04fa5570bb269e62},
    {"uastc-every-mode-52x52", 52, 52, 0x1de2248e3cf535b1},
    {"uastc-zstd-mipmaps-64x48", 64, 48, 0x42fee7b7ba102fba},
};

std::string ReadSample(const std::string& name) {
  auto bytes = ReadFile(std::string(LUMIFOLD_PICTURE_CORPUS) + "/" + name + ".ktx2", 1 << 20);
  EXPECT_TRUE(bytes.ok()) << bytes.status();
  return bytes.ok() ? *std::move(bytes) : "";
}

uint64_t HashOf(const std::vector<uint8_t>& bytes) {
  uint64_t hash = 0xcbf29ce484222325;
  for (const uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001b3;
  return hash;
}

std::string Ktx2ErrorOf(const std::string& bytes) {
  return std::string(DecodeKtx2(bytes, kEnoughPixels).status().message());
}

/// Little-endian.
void SetNumber(std::string* bytes, size_t offset, uint64_t value, size_t count = 4) {
  for (size_t i = 0; i < count; ++i) (*bytes)[offset + i] = static_cast<char>(value >> (8 * i));
}

void Append(std::string* bytes, uint64_t value, size_t count = 4) {
  bytes->resize(bytes->size() + count);
  SetNumber(bytes, bytes->size() - count, value, count);
}

/// A UASTC file of 1x1 pixel with the colour (10, 20, 30, 40).
struct OnePixelFile {
  uint32_t color_model = 166;
  uint32_t channel = 3;  // RGBA
  uint32_t flags = 0;
  std::string key = "", value = "";

  std::string Bytes() const {
    const std::string entry = key.empty() ? "" : key + '\0' + value + '\0';
    const size_t padded = key.empty() ? 0 : 4 + (entry.size() + 3) / 4 * 4;
    constexpr uint32_t kDescriptorAt = 104, kDescriptorBytes = 44,
                       kMetadataAt = kDescriptorAt + kDescriptorBytes;
    std::string bytes("\xabKTX 20\xbb\r\n\x1a\n", 12);
    for (const uint32_t field : {0, 1, 1, 1, 0, 0, 1, 1, 0}) Append(&bytes, field);
    Append(&bytes, kDescriptorAt);
    Append(&bytes, kDescriptorBytes);
    Append(&bytes, kMetadataAt);
    Append(&bytes, padded);
    for (const uint64_t field :
         {uint64_t{0}, uint64_t{0}, kMetadataAt + uint64_t{padded}, uint64_t{16}, uint64_t{16}})
      Append(&bytes, field, 8);
    for (const uint32_t field : {44u, 0u, 2u | 40u << 16, color_model | 1u << 8 | 1u << 16 | flags << 24,
                                 0x303u, 16u, 0u, 127u << 16 | channel << 24, 0u, 0u, ~0u})
      Append(&bytes, field);
    if (!key.empty()) {
      Append(&bytes, entry.size());
      bytes += entry;
      bytes.resize(kMetadataAt + padded);
    }
    // The block: the mode of one colour, then its channels.
    const uint64_t color = 10 | 20 << 8 | 30 << 16 | uint64_t{40} << 24;
    Append(&bytes, 0x17 | color << 5, 8);
    Append(&bytes, 0, 8);
    return bytes;
  }
};

std::vector<uint8_t> PixelOf(const OnePixelFile& file) {
  const auto image = DecodeKtx2(file.Bytes(), kEnoughPixels);
  EXPECT_TRUE(image.ok()) << image.status();
  return image.ok() ? image->rgba : std::vector<uint8_t>();
}

TEST(Ktx2, DecodesAsTheReferenceDoes) {
  for (const Ktx2Sample& sample : kKtx2Samples) {
    const auto image = DecodeImage(ReadSample(sample.name), kEnoughPixels);
    ASSERT_TRUE(image.ok()) << sample.name << ": " << image.status();
    EXPECT_EQ(image->width, sample.width);
    EXPECT_EQ(image->height, sample.height);
    EXPECT_EQ(HashOf(image->rgba), sample.hash) << sample.name;
  }
}

TEST(Ktx2, RefusesEveryTruncation) {
  for (const Ktx2Sample& sample : kKtx2Samples) {
    const std::string whole = ReadSample(sample.name);
    for (size_t n = 0; n < whole.size(); ++n)
      EXPECT_FALSE(DecodeKtx2(whole.substr(0, n), kEnoughPixels).ok()) << sample.name << " " << n;
  }
}

TEST(Ktx2, DamageGivesAnErrorOrAPicture) {
  std::mt19937 random(1);
  for (const Ktx2Sample& sample : kKtx2Samples) {
    const std::string whole = ReadSample(sample.name);
    for (int i = 0; i < 500; ++i) {
      std::string bytes = whole;
      for (size_t flips = 1 + random() % 3; flips > 0; --flips)
        bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
      const auto image = DecodeKtx2(bytes, kEnoughPixels);
      if (image.ok()) {
        EXPECT_EQ(image->rgba.size(),
                  4u * static_cast<size_t>(image->width) * static_cast<size_t>(image->height));
      }
    }
  }
}

TEST(Ktx2, HonoursChannelsAndSwizzle) {
  EXPECT_THAT(PixelOf({}), ElementsAre(10, 20, 30, 40));
  EXPECT_THAT(PixelOf({.channel = 4}), ElementsAre(10, 0, 0, 255));
  EXPECT_THAT(PixelOf({.channel = 5}), ElementsAre(10, 40, 0, 255));
  EXPECT_THAT(PixelOf({.key = "KTXswizzle", .value = "bg1r"}), ElementsAre(30, 20, 255, 10));
  EXPECT_THAT(PixelOf({.channel = 5, .key = "KTXswizzle", .value = "rrrg"}), ElementsAre(10, 10, 10, 40));
  EXPECT_THAT(PixelOf({.key = "KTXorientation", .value = "rd"}), ElementsAre(10, 20, 30, 40));
  EXPECT_THAT(Ktx2ErrorOf(OnePixelFile{.key = "KTXswizzle", .value = "rgbx"}.Bytes()),
              HasSubstr("KTXswizzle"));
}

TEST(Ktx2, RefusesWhatIsNoTexture) {
  EXPECT_EQ(Ktx2ErrorOf(OnePixelFile{.key = "KTXorientation", .value = "ru"}.Bytes()),
            "a KTX2 picture that is not stored from the top left is no texture");
  EXPECT_EQ(Ktx2ErrorOf(OnePixelFile{.flags = 1}.Bytes()),
            "a KTX2 picture whose alpha is premultiplied is no texture");
  EXPECT_EQ(Ktx2ErrorOf(OnePixelFile{.color_model = 167}.Bytes()),
            "a KTX2 picture of color model 167 (glTF has only ETC1S and UASTC)");
  std::string bytes = OnePixelFile().Bytes();
  SetNumber(&bytes, 12, 37);
  EXPECT_EQ(Ktx2ErrorOf(bytes), "a KTX2 picture of Vulkan format 37 (glTF has only ETC1S and UASTC)");
  for (const size_t depth_layers_faces : {28, 32, 36}) {
    bytes = OnePixelFile().Bytes();
    SetNumber(&bytes, depth_layers_faces, 6);
    EXPECT_EQ(Ktx2ErrorOf(bytes), "a KTX2 picture that is not a single 2D picture is no texture");
  }
  bytes = OnePixelFile().Bytes();
  SetNumber(&bytes, 44, 3);
  EXPECT_EQ(Ktx2ErrorOf(bytes), "a KTX2 picture of UASTC with supercompression 3");
  bytes = ReadSample("etc1s-1x1");
  const size_t image_flags =
      20 + static_cast<unsigned char>(bytes[64]) + 256u * static_cast<unsigned char>(bytes[65]);
  SetNumber(&bytes, image_flags, 2);
  EXPECT_EQ(Ktx2ErrorOf(bytes), "a KTX2 picture that depends on another frame is no texture");
}

TEST(Ktx2, RefusesBombsBeforeTheyTakeMemory) {
  std::string bytes = ReadSample("etc1s-1x1");
  SetNumber(&bytes, 20, 1 << 19);
  EXPECT_EQ(DecodeKtx2(bytes, kEnoughPixels).status().code(), absl::StatusCode::kResourceExhausted);
  bytes = OnePixelFile().Bytes();
  SetNumber(&bytes, 20, 1 << 19);
  EXPECT_THAT(std::string(DecodeKtx2(bytes, int64_t{1} << 40).status().message()),
              HasSubstr("not the bytes of its pixels"));
  constexpr uint64_t kBlocks = uint64_t{1} << 34;  // 2^19 x 2^19 pixels
  SetNumber(&bytes, 24, 1 << 19);
  SetNumber(&bytes, 44, 2);
  SetNumber(&bytes, 96, 16 * kBlocks, 8);
  EXPECT_EQ(DecodeKtx2(bytes, int64_t{1} << 40).status().message(),
            "claims 524288x524288 pixels, but has only 16 bytes");
  // More than it says.
  bytes = ReadSample("uastc-zstd-mipmaps-64x48");
  SetNumber(&bytes, 20, 60);
  SetNumber(&bytes, 96, 15 * 12 * 16, 8);
  EXPECT_THAT(Ktx2ErrorOf(bytes), HasSubstr("damaged KTX2: Destination buffer is too small"));
}

}  // namespace
}  // namespace lumifold::scene
