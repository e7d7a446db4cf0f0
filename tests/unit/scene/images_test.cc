#include "worker/scene/images/decode_image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <webp/encode.h>

#include "tests/support/gltf_fixture.h"

namespace lumifold::scene {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr int64_t kPlenty = 1 << 20;

ImageData MustDecode(const std::string& bytes) {
  auto image = DecodeImage(bytes, kPlenty);
  EXPECT_TRUE(image.ok()) << image.status();
  return image.ok() ? *std::move(image) : ImageData{};
}

TEST(Images, DecodePngOfEveryChannelCount) {
  EXPECT_THAT(MustDecode(EncodePng(1, 1, 1, 8, false, {7})).rgba, ElementsAre(7, 7, 7, 255));
  EXPECT_THAT(MustDecode(EncodePng(1, 1, 2, 8, false, {7, 8})).rgba, ElementsAre(7, 7, 7, 8));
  EXPECT_THAT(MustDecode(EncodePng(1, 1, 3, 8, false, {1, 2, 3})).rgba, ElementsAre(1, 2, 3, 255));
  EXPECT_THAT(MustDecode(EncodePng(1, 1, 4, 8, false, {1, 2, 3, 4})).rgba, ElementsAre(1, 2, 3, 4));
}

TEST(Images, KeepAllBitsOfSixteenBitPng) {
  const ImageData colour = MustDecode(EncodePng(1, 1, 3, 16, false, {0xff, 0xff, 0x81, 0x00, 0, 1}));
  EXPECT_THAT(colour.rgba16, ElementsAre(65535, 0x8100, 1, 65535));
  EXPECT_THAT(colour.rgba, ElementsAre());
  const ImageData grey = MustDecode(EncodePng(1, 1, 2, 16, true, {0x12, 0x34, 0x56, 0x78}));
  EXPECT_THAT(grey.rgba16, ElementsAre(0x1234, 0x1234, 0x1234, 0x5678));
}

TEST(Images, DecodeInterlacedPngWithTheFirstRowOnTop) {
  std::vector<uint8_t> samples;
  for (int i = 0; i < 9 * 11; ++i) samples.push_back(static_cast<uint8_t>(i));
  const ImageData image = MustDecode(EncodePng(9, 11, 1, 8, true, samples));
  ASSERT_EQ(image.width, 9);
  ASSERT_EQ(image.height, 11);
  for (size_t i = 0; i < samples.size(); ++i) EXPECT_EQ(image.rgba[4 * i], samples[i]);
}

TEST(Images, DecodeJpegInColorAndGrey) {
  for (const bool progressive : {false, true}) {
    std::vector<uint8_t> samples;
    for (int i = 0; i < 16 * 16; ++i) samples.insert(samples.end(), {200, 100, 50});
    const ImageData color = MustDecode(EncodeJpeg(16, 16, 3, progressive, samples));
    ASSERT_EQ(color.rgba.size(), 16u * 16 * 4);
    EXPECT_NEAR(color.rgba[0], 200, 2);
    EXPECT_NEAR(color.rgba[1], 100, 2);
    EXPECT_NEAR(color.rgba[2], 50, 2);
    EXPECT_EQ(color.rgba[3], 255);
    const ImageData grey = MustDecode(EncodeJpeg(8, 8, 1, progressive, std::vector<uint8_t>(64, 77)));
    EXPECT_THAT(std::vector<uint8_t>(grey.rgba.begin(), grey.rgba.begin() + 4), ElementsAre(77, 77, 77, 255));
  }
}

TEST(Images, RefuseCmykJpeg) {
  const auto image = DecodeImage(EncodeJpeg(8, 8, 4, false, std::vector<uint8_t>(256, 9)), kPlenty);
  EXPECT_THAT(std::string(image.status().message()), HasSubstr("damaged JPEG: Unsupported color conversion"));
}

TEST(Images, RefuseOtherFormats) {
  for (const char* bytes : {"", "GIF89a", "\x89PNG", "\xff\xd8"}) {
    EXPECT_EQ(DecodeImage(bytes, kPlenty).status().message(), "neither PNG, JPEG, WebP nor KTX2");
  }
}

TEST(Images, RefuseEveryTruncation) {
  std::vector<uint8_t> samples;
  for (int i = 0; i < 24 * 24 * 3; ++i) samples.push_back(static_cast<uint8_t>(i * i));
  for (const std::string& whole :
       {EncodePng(24, 24, 3, 8, false, samples), EncodeJpeg(24, 24, 3, false, samples)}) {
    ASSERT_TRUE(DecodeImage(whole, kPlenty).ok());
    // JPEG's last two bytes are the end marker; without it the picture is still complete.
    for (size_t n = 0; n + 2 < whole.size(); ++n) {
      EXPECT_FALSE(DecodeImage(whole.substr(0, n), kPlenty).ok()) << n << " of " << whole.size();
    }
  }
}

TEST(Images, RefuseDamagedPng) {
  std::string png = EncodePng(8, 8, 1, 8, false, std::vector<uint8_t>(64, 3));
  png[png.find("IDAT") + 8] ^= 0x55;
  EXPECT_THAT(std::string(DecodeImage(png, kPlenty).status().message()), HasSubstr("damaged PNG: "));
}

std::string EncodeWebp(int width, int height, const std::vector<uint8_t>& rgba) {
  uint8_t* bytes = nullptr;
  const size_t size = WebPEncodeLosslessRGBA(rgba.data(), width, height, 4 * width, &bytes);
  std::string webp(reinterpret_cast<const char*>(bytes), size);
  WebPFree(bytes);
  return webp;
}

TEST(Images, DecodeWebpWithAndWithoutLoss) {
  std::vector<uint8_t> rgba;
  for (int i = 0; i < 13 * 7; ++i)
    rgba.insert(rgba.end(), {static_cast<uint8_t>(i), static_cast<uint8_t>(255 - i), 7, 255});
  rgba[3] = 9;
  const std::string webp = EncodeWebp(13, 7, rgba);
  const ImageData image = MustDecode(webp);
  EXPECT_EQ(image.width, 13);
  EXPECT_EQ(image.height, 7);
  EXPECT_EQ(image.rgba, rgba);
  uint8_t* bytes = nullptr;
  const std::vector<uint8_t> grey(16 * 16 * 3, 77);
  const size_t size = WebPEncodeRGB(grey.data(), 16, 16, 48, 90, &bytes);
  const ImageData lossy = MustDecode(std::string(reinterpret_cast<const char*>(bytes), size));
  WebPFree(bytes);
  EXPECT_NEAR(lossy.rgba[0], 77, 2);
  EXPECT_EQ(lossy.rgba[3], 255);
}

TEST(Images, RefuseWebpThatIsCutShortOrTooLarge) {
  const std::string webp = EncodeWebp(300, 300, std::vector<uint8_t>(300 * 300 * 4, 5));
  EXPECT_EQ(DecodeImage(webp, 300 * 300 - 1).status().message(),
            "300x300 pixels are over the limit of 89999");
  for (size_t n = 0; n < webp.size(); ++n) EXPECT_FALSE(DecodeImage(webp.substr(0, n), kPlenty).ok()) << n;
}

/// A PNG header that claims this size, with a correct checksum, which libpng accepts.
std::string ClaimedSize(int width, int height) {
  // Encoded as one row of `width`; the height and the checksum are then taken from a PNG of the right size.
  return EncodePng(width, height, 1, 8, false, std::vector<uint8_t>(static_cast<size_t>(width) * height, 0));
}

TEST(Images, CheckThePixelLimitBeforeDecoding) {
  const std::string png = ClaimedSize(300, 300);
  EXPECT_TRUE(DecodeImage(png, 300 * 300).ok());
  const auto image = DecodeImage(png, 300 * 300 - 1);
  EXPECT_EQ(image.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(image.status().message(), "300x300 pixels are over the limit of 89999");
  // Everything after the header is missing, but the error is about the size.
  EXPECT_EQ(DecodeImage(png.substr(0, 60), 100).status().message(),
            "300x300 pixels are over the limit of 100");
}

TEST(Images, RefuseMorePixelsThanTheBytesCanHold) {
  const std::string bomb = ClaimedSize(3000, 3000).substr(0, 100);
  const auto image = DecodeImage(bomb, int64_t{1} << 31);
  EXPECT_EQ(image.status().message(), "claims 3000x3000 pixels, but has only 100 bytes");
}

}  // namespace
}  // namespace lumifold::scene
