#include "proto/rpc/image_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/plane_codec.h"

namespace lumifold::rpc {
namespace {

using ::testing::HasSubstr;

/// Values with random bits, which no compression shrinks.
LayeredImage RandomImage(int width, int height, int channels, uint32_t seed) {
  std::mt19937 random(seed);
  LayeredImage image(width, height);
  for (int c = 0; c < channels; ++c) {
    const FloatView view = image.Add("layer" + std::to_string(c) + ".R");
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) view.At(x, y) = std::bit_cast<float>(static_cast<uint32_t>(random()));
    }
  }
  return image;
}

/// Gives a plane values that compress.
void FillSmooth(Plane* plane) {
  for (int y = 0; y < plane->height(); ++y) {
    for (int x = 0; x < plane->width(); ++x) plane->At(x, y) = std::sqrt(1.0f + static_cast<float>(x + y));
  }
}

std::vector<v1::PixelChunk> ChunksOf(const LayeredImage& image) {
  std::vector<v1::PixelChunk> chunks;
  PixelChunker chunker(image);
  while (chunker.Next(&chunks.emplace_back())) {
  }
  chunks.pop_back();
  return chunks;
}

absl::Status AddAll(const std::vector<v1::PixelChunk>& chunks, PixelAssembler* assembler) {
  for (const v1::PixelChunk& chunk : chunks) {
    if (absl::Status status = assembler->Add(chunk); !status.ok()) return status;
  }
  return absl::OkStatus();
}

void ExpectSame(const LayeredImage& a, const LayeredImage& b) {
  EXPECT_EQ(LayoutOf(a).SerializeAsString(), LayoutOf(b).SerializeAsString());
  EXPECT_EQ(BytesFromImage(a), BytesFromImage(b));
}

std::string BytesOf(const ReceivedPicture& picture) {
  std::string bytes;
  for (const PixelPiece& piece : picture.pieces) bytes += piece.bytes;
  return bytes;
}

TEST(ImageCodec, RoundTripsPicturesOfOddSizes) {
  for (const int width : {1, 3, 32, 257, 1031}) {
    for (const int height : {1, 7, 300}) {
      const LayeredImage image = RandomImage(width, height, 5, 1);
      PixelAssembler assembler;
      ASSERT_TRUE(AddAll(ChunksOf(image), &assembler).ok());
      ASSERT_TRUE(assembler.IsComplete());
      const ReceivedPicture picture = assembler.Take();
      EXPECT_EQ(picture.layout.SerializeAsString(), EncodePicture(image).layout.SerializeAsString());
      EXPECT_EQ(ChecksumOf(picture.pieces), Checksum(BytesOf(picture)));
      ExpectSame(*ImageFromBytes(picture.layout, BytesOf(picture), {}), image);
    }
  }
}

TEST(ImageCodec, ChunksAreFullButTheLast) {
  const LayeredImage image = RandomImage(700, 300, 3, 2);
  const std::vector<v1::PixelChunk> chunks = ChunksOf(image);
  ASSERT_EQ(chunks.size(), 3u);
  EXPECT_EQ(chunks[0].data().size(), kMaxChunkBytes);
  EXPECT_EQ(chunks[1].data().size(), kMaxChunkBytes);
  EXPECT_EQ(chunks[2].data().size(), 700u * 300 * 3 * 4 - 2 * kMaxChunkBytes);
  EXPECT_TRUE(chunks[0].has_layout());
  EXPECT_FALSE(chunks[1].has_layout());
  EXPECT_TRUE(chunks[2].last());
}

TEST(ImageCodec, KeepsNanAndSignedZero) {
  LayeredImage image(2, 1);
  const FloatView view = image.Add("A");
  view.At(0, 0) = std::numeric_limits<float>::quiet_NaN();
  view.At(1, 0) = -0.0f;
  const absl::StatusOr<LayeredImage> copy = ImageFromBytes(LayoutOf(image), BytesFromImage(image), {});
  ASSERT_TRUE(copy.ok());
  ExpectSame(*copy, image);
}

TEST(ImageCodec, EveryFlippedBitOfTheDataIsFound) {
  const LayeredImage image = RandomImage(5, 3, 2, 3);
  const v1::PixelChunk good = ChunksOf(image).front();
  for (size_t bit = 0; bit < good.data().size() * 8; ++bit) {
    v1::PixelChunk bad = good;
    (*bad.mutable_data())[bit / 8] ^= static_cast<char>(1 << bit % 8);
    PixelAssembler assembler;
    ASSERT_EQ(assembler.Add(bad).code(), absl::StatusCode::kDataLoss) << bit;
  }
}

TEST(ImageCodec, AnyDamageOfTheSerialisedChunkEndsInAStatus) {
  const LayeredImage image = RandomImage(4, 4, 3, 4);
  const std::string good = ChunksOf(image).front().SerializeAsString();
  std::mt19937 random(5);
  for (size_t at = 0; at < good.size(); ++at) {
    for (int repeat = 0; repeat < 8; ++repeat) {
      std::string bad = good;
      bad[at] = static_cast<char>(random());
      v1::PixelChunk chunk;
      if (!chunk.ParseFromString(bad)) continue;
      PixelAssembler assembler(PixelLimits{.max_bytes = 1 << 20});
      if (!assembler.Add(chunk).ok() || !assembler.IsComplete()) continue;
      // An accepted chunk must have the same pixels: only the channel names have no checksum.
      const ReceivedPicture picture = assembler.Take();
      EXPECT_EQ(BytesFromImage(*ImageFromBytes(picture.layout, BytesOf(picture), {})), BytesFromImage(image));
    }
  }
}

v1::PlaneEncoding EncodingOfValues(const std::vector<float>& values) {
  LayeredImage image(static_cast<int>(values.size()), 1);
  const FloatView view = image.Add("A");
  std::copy(values.begin(), values.end(), view.Row(0));
  const EncodedPicture picture = EncodePicture(image);
  EXPECT_EQ(picture.bytes.size(), EncodedBytesOf(picture.layout));
  EXPECT_EQ(BytesFromImage(*ImageFromBytes(picture.layout, picture.bytes, {})), BytesFromImage(image));
  return picture.layout.encodings(0);
}

TEST(ImageCodec, APlaneHasTheFirstEncodingThatCanHoldIt) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float value : {0.0f, -0.0f, 0.1f, kNan, kInfinity})
    EXPECT_EQ(EncodingOfValues({value, value, value}), v1::PLANE_ENCODING_CONSTANT) << value;
  EXPECT_EQ(EncodingOfValues({0.0f, -0.0f}), v1::PLANE_ENCODING_HALF);
  EXPECT_EQ(EncodingOfValues({0.0f, 1.0f / 16, 2048.0f, -65504.0f}), v1::PLANE_ENCODING_HALF);
  for (const float value :
       {0.1f, 2049.0f, 65520.0f, 65536.0f, 0x1p-25f, 0x1.8p-24f, 0x1p-149f, kNan, kInfinity})
    EXPECT_EQ(EncodingOfValues({0.0f, value}), v1::PLANE_ENCODING_FLOAT) << value;
  std::vector<float> alike(100, 0.1f);
  alike.back() = 0.2f;
  EXPECT_EQ(EncodingOfValues(alike), v1::PLANE_ENCODING_ZSTD);
}

/// Halves by their definition: sign, exponent with bias 15, mantissa of 10 bits.
TEST(ImageCodec, EveryHalfIsExactAndNothingElseIsOne) {
  for (uint32_t half = 0; half < 1u << 16; ++half) {
    const int exponent = static_cast<int>(half >> 10 & 31);
    const double mantissa = half & 1023;
    if (exponent == 31) continue;  // infinities and NaN, which stay floats
    const double magnitude =
        exponent == 0 ? std::ldexp(mantissa, -24) : std::ldexp(1024 + mantissa, exponent - 25);
    const auto value = static_cast<float>(half >> 15 != 0 ? -magnitude : magnitude);
    const float other = value == 1.0f ? 2.0f : 1.0f;
    ASSERT_EQ(EncodingOfValues({value, other}), v1::PLANE_ENCODING_HALF) << value;
    for (const float direction : {-1e9f, 1e9f})
      ASSERT_EQ(EncodingOfValues({std::nextafter(value, direction), other}), v1::PLANE_ENCODING_FLOAT)
          << value;
  }
}

TEST(ImageCodec, RoundingToHalvesTakesTheNearestThatThereIs) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const std::vector<float> values = {0.1f,
                                     -0.1f,
                                     2049.0f,
                                     2051.0f,
                                     70000.0f,
                                     -kInfinity,
                                     0x1p-25f,
                                     0x1.8p-25f,
                                     0x1.8p-24f,
                                     65519.0f,
                                     std::numeric_limits<float>::quiet_NaN()};
  const std::vector<float> expected = {
      0x1.998p-4f, -0x1.998p-4f, 2050.0f,  2052.0f,  65504.0f, -65504.0f,
      0x1p-24f,    0x1p-24f,     0x1p-23f, 65504.0f, 0.0f};  // ties go away from 0
  Plane plane(static_cast<int>(values.size()), 1);
  std::copy(values.begin(), values.end(), plane.Row(0));
  RoundToHalf(plane.view());
  for (size_t i = 0; i < values.size(); ++i)
    EXPECT_EQ(plane.At(static_cast<int>(i), 0), expected[i]) << values[i];
}

TEST(ImageCodec, AMixOfEncodingsRoundTripsAcrossPieces) {
  LayeredImage image = RandomImage(257, 300, 11, 9);  // an odd width: halves end anywhere
  for (const size_t plane : {size_t{0}, size_t{4}, size_t{8}}) image.channels()[plane].plane.Fill(0.1f);
  for (const size_t plane : {size_t{1}, size_t{5}}) {
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x)
        image.channels()[plane].plane.At(x, y) = static_cast<float>((x + y) % 7) / 16;
    }
  }
  FillSmooth(&image.channels()[2].plane);
  FillSmooth(&image.channels()[6].plane);
  PixelAssembler assembler;
  const std::vector<v1::PixelChunk> chunks = ChunksOf(image);
  ASSERT_EQ(chunks.size(), 2u);
  ASSERT_TRUE(AddAll(chunks, &assembler).ok());
  const ReceivedPicture picture = assembler.Take();
  ASSERT_EQ(picture.layout.compressed_bytes_size(), 2);
  EXPECT_EQ(BytesOf(picture).size(), 3u * 4 + 2 * 2 * 257 * 300 + 4 * 4 * 257 * 300 +
                                         picture.layout.compressed_bytes(0) +
                                         picture.layout.compressed_bytes(1));
  ExpectSame(*ImageFromBytes(picture.layout, BytesOf(picture), {}), image);
}

TEST(ImageCodec, ACompressedPlaneThatIsDamagedIsNamed) {
  LayeredImage image = RandomImage(16, 16, 2, 1);
  FillSmooth(&image.channels()[1].plane);
  EncodedPicture picture = EncodePicture(image);
  ASSERT_EQ(picture.layout.compressed_bytes_size(), 1);
  picture.bytes[picture.bytes.size() - picture.layout.compressed_bytes(0)] ^= 1;
  const absl::Status status = ImageFromBytes(picture.layout, picture.bytes, {}).status();
  EXPECT_EQ(status.message(), "pixels: layer1.R cannot be decompressed: not one zstd frame");
}

TEST(ImageCodec, RefusesAPictureThatIsTooLargeHoweverFewItsBytes) {
  LayeredImage image(512, 512);
  for (int i = 0; i < 100; ++i) image.Add(absl::StrCat("c", i));
  const std::vector<v1::PixelChunk> chunks = ChunksOf(image);
  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].data().size(), 400u);
  PixelAssembler assembler(PixelLimits{.max_bytes = 100u * 512 * 512 * 4 - 1});
  EXPECT_THAT(std::string(assembler.Add(chunks[0]).message()), HasSubstr("bytes are more than"));
  EXPECT_EQ(assembler.HeldBytes(), 0u);
  EXPECT_FALSE(
      ImageFromBytes(chunks[0].layout(), chunks[0].data(), {.max_bytes = 100u * 512 * 512 * 4 - 1}).ok());
}

/// Makes the first plane one that is compressed to `bytes`.
void Compress(uint32_t bytes, v1::PixelLayout* layout) {
  layout->set_encodings(0, v1::PLANE_ENCODING_ZSTD);
  layout->add_compressed_bytes(bytes);
}

struct Misuse {
  const char* name;
  std::function<void(std::vector<v1::PixelChunk>&)> spoil;
  const char* message;
};

TEST(ImageCodec, MisuseIsNamed) {
  const LayeredImage image = RandomImage(700, 300, 3, 6);
  const std::vector<Misuse> misuses = {
      {"gap", [](auto& c) { c.erase(c.begin() + 1); }, "number 2, expected 1"},
      {"repeat", [](auto& c) { c.insert(c.begin(), c.front()); }, "number 0, expected 1"},
      {"after last", [](auto& c) { c.push_back(c.back()); }, "a chunk after the last one"},
      {"no layout", [](auto& c) { c[0].clear_layout(); }, "must have the layout"},
      {"second layout", [](auto& c) { *c[1].mutable_layout() = c[0].layout(); }, "must have the layout"},
      {"short", [](auto& c) { c[0].mutable_data()->resize(100); }, "100 bytes, expected 1048576"},
      {"early last", [](auto& c) { c[0].set_last(true); }, "`last` is set on the wrong chunk"},
      {"no last", [](auto& c) { c[2].set_last(false); }, "`last` is set on the wrong chunk"},
      {"checksum", [](auto& c) { c[1].set_checksum(1); }, "checksum does not match"},
      {"width", [](auto& c) { c[0].mutable_layout()->set_width(0); }, "size 0x300"},
      {"negative", [](auto& c) { c[0].mutable_layout()->set_height(-1); }, "size 700x-1"},
      {"huge", [](auto& c) { c[0].mutable_layout()->set_width(2000000000); }, "size 2000000000x300"},
      {"no channels", [](auto& c) { c[0].mutable_layout()->clear_channels(); }, "0 channels"},
      {"twice", [](auto& c) { c[0].mutable_layout()->set_channels(1, c[0].layout().channels(0)); },
       "appears twice"},
      {"empty name", [](auto& c) { c[0].mutable_layout()->set_channels(1, ""); }, "name of channel 1"},
      {"long name", [](auto& c) { c[0].mutable_layout()->set_channels(1, std::string(65, 'x')); },
       "name of channel 1"},
      {"control", [](auto& c) { c[0].mutable_layout()->set_channels(1, "a\nb"); }, "name of channel 1"},
      {"fewer encodings", [](auto& c) { c[0].mutable_layout()->mutable_encodings()->RemoveLast(); },
       "2 encodings of 3 channels"},
      {"more encodings", [](auto& c) { c[0].mutable_layout()->add_encodings(v1::PLANE_ENCODING_HALF); },
       "4 encodings of 3 channels"},
      {"unknown encoding",
       [](auto& c) { c[0].mutable_layout()->set_encodings(1, static_cast<v1::PlaneEncoding>(9)); },
       "unknown encoding 9"},
      {"no size of a compressed plane",
       [](auto& c) { c[0].mutable_layout()->set_encodings(0, v1::PLANE_ENCODING_ZSTD); },
       "0 sizes of 1 compressed planes"},
      {"a size without a compressed plane", [](auto& c) { c[0].mutable_layout()->add_compressed_bytes(1); },
       "1 sizes of 0 compressed planes"},
      {"a compressed plane of no bytes", [](auto& c) { Compress(0, c[0].mutable_layout()); },
       "a compressed plane of 0 bytes, not 1 to 839999"},
      {"a compressed plane that is not smaller", [](auto& c) { Compress(840000, c[0].mutable_layout()); },
       "a compressed plane of 840000 bytes"},
      {"fewer compressed bytes", [](auto& c) { Compress(5, c[0].mutable_layout()); }, "chunk 1: "},
      {"smaller encoding",
       [](auto& c) { c[0].mutable_layout()->set_encodings(0, v1::PLANE_ENCODING_CONSTANT); }, "chunk 1: "},
      {"bytes",
       [](auto& c) { c[0].mutable_layout()->set_width(16384), c[0].mutable_layout()->set_height(16384); },
       "bytes are more than"},
  };
  for (const Misuse& misuse : misuses) {
    std::vector<v1::PixelChunk> chunks = ChunksOf(image);
    misuse.spoil(chunks);
    PixelAssembler assembler(PixelLimits{.max_bytes = 1 << 30});
    const absl::Status status = AddAll(chunks, &assembler);
    EXPECT_FALSE(status.ok()) << misuse.name;
    EXPECT_THAT(std::string(status.message()), HasSubstr(misuse.message)) << misuse.name;
  }
}

TEST(ImageCodec, AfterAnErrorEveryCallFails) {
  const LayeredImage image = RandomImage(700, 300, 3, 7);
  const std::vector<v1::PixelChunk> chunks = ChunksOf(image);
  PixelAssembler assembler;
  ASSERT_TRUE(assembler.Add(chunks[0]).ok());
  ASSERT_FALSE(assembler.Add(chunks[2]).ok());
  EXPECT_FALSE(assembler.Add(chunks[1]).ok());
  EXPECT_FALSE(assembler.IsComplete());
}

TEST(ImageCodec, HoldsNoMoreThanHasArrived) {
  const LayeredImage image = RandomImage(700, 300, 30, 8);
  const std::vector<v1::PixelChunk> chunks = ChunksOf(image);
  PixelAssembler assembler;
  EXPECT_EQ(assembler.HeldBytes(), 0u);
  ASSERT_TRUE(assembler.Add(chunks[0]).ok());
  EXPECT_LE(assembler.HeldBytes(), 2u * 700 * 300 * 4);
}

}  // namespace
}  // namespace lumifold::rpc
