#include "filter/image/exr_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "filter/image/planes.h"
#include "tests/support/peak_memory.h"

namespace lumifold {
namespace {

using ::testing::HasSubstr;

std::string TestPath(const std::string& name) {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  return ::testing::TempDir() + "lumifold_exr_" + test->name() + "_" + name;
}

LayeredImage SampleImage(int width, int height) {
  LayeredImage image(width, height);
  int64_t count = 0;
  for (const char* layer : {"direct_a", ""}) {
    for (const FloatView& channel : image.AddColor(layer)) {
      ForEachPixel(width, height, [&](int x, int y) {
        channel.At(x, y) = static_cast<float>(++count % 977) * 0.37f - 3.0f;
      });
    }
  }
  image.metadata()["lumifold:job"] = "j-42";
  return image;
}

TEST(Exr, ReadsBackEveryFloatAndTheMetadata) {
  const std::string path = TestPath("a.exr");
  LayeredImage image = SampleImage(37, 21);
  image.Get("R").At(0, 0) = std::numeric_limits<float>::denorm_min();
  image.Get("R").At(1, 0) = std::numeric_limits<float>::infinity();
  ASSERT_TRUE(WriteExr(path, image).ok());
  const auto read = ReadExr(path);
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->bounds(), image.bounds());
  EXPECT_EQ(read->channels().size(), image.channels().size());
  EXPECT_EQ(read->metadata().at("lumifold:job"), "j-42");
  for (const LayeredImage::Channel& channel : image.channels()) {
    ASSERT_TRUE(read->Has(channel.name)) << channel.name;
    for (int y = 0; y < image.height(); ++y) {
      for (int x = 0; x < image.width(); ++x) {
        ASSERT_EQ(read->Get(channel.name).At(x, y), channel.plane.At(x, y))
            << channel.name << " " << x << "," << y;
      }
    }
  }
}

TEST(Exr, WritesTheSameBytesForTheSamePicture) {
  ASSERT_TRUE(WriteExr(TestPath("a.exr"), SampleImage(64, 40)).ok());
  ASSERT_TRUE(WriteExr(TestPath("b.exr"), SampleImage(64, 40)).ok());
  EXPECT_EQ(ReadFile(TestPath("a.exr"), 1 << 24).value(), ReadFile(TestPath("b.exr"), 1 << 24).value());
}

TEST(Exr, KeepsListsBesideThePicture) {
  const std::string path = TestPath("a.exr");
  EdgedImage image{SampleImage(37, 21), LayeredImage(kSubSamples, 70), LayeredImage(1, 33)};
  const FloatView id = image.edges.Add("id.Y");
  for (int row = 0; row < 70; ++row) {
    for (int i = 0; i < kSubSamples; ++i) id.At(i, row) = static_cast<float>(row * kSubSamples + i);
  }
  const FloatView surface = image.fragments.Add("surface.Y");
  for (int row = 0; row < 33; ++row) surface.At(0, row) = static_cast<float>(row * 1000003 % 16777213);
  ASSERT_TRUE(WriteExr(path, image).ok());
  const auto read = ReadEdgedExr(path);
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->fragments.bounds(), image.fragments.bounds());
  for (int row = 0; row < 33; ++row)
    ASSERT_EQ(read->fragments.Get("surface.Y").At(0, row), surface.At(0, row));
  EXPECT_EQ(read->pixels.Get("G").At(36, 20), image.pixels.Get("G").At(36, 20));
  EXPECT_EQ(read->pixels.metadata().at("lumifold:job"), "j-42");
  ASSERT_EQ(read->edges.bounds(), image.edges.bounds());
  for (int row = 0; row < 70; ++row) {
    for (int i = 0; i < kSubSamples; ++i) ASSERT_EQ(read->edges.Get("id.Y").At(i, row), id.At(i, row));
  }
  EXPECT_EQ(ReadExr(path)->bounds(), image.pixels.bounds());  // the picture alone
  const std::string bytes = ReadFile(path, 1 << 24).value();
  ASSERT_TRUE(WriteExr(path, image).ok());
  EXPECT_EQ(ReadFile(path, 1 << 24).value(), bytes);
  for (const size_t keep : {bytes.size() / 2, bytes.size() - 1}) {
    ASSERT_TRUE(WriteFileAtomically(path, bytes.substr(0, keep)).ok());
    EXPECT_EQ(ReadExr(path).status().code(), absl::StatusCode::kInvalidArgument) << keep;
  }
}

TEST(Exr, WithoutListsAFileHasOnePart) {
  ASSERT_TRUE(WriteExr(TestPath("a.exr"), SampleImage(8, 5)).ok());
  ASSERT_TRUE(WriteExr(TestPath("b.exr"), EdgedImage{SampleImage(8, 5)}).ok());
  EXPECT_EQ(ReadFile(TestPath("a.exr"), 1 << 24).value(), ReadFile(TestPath("b.exr"), 1 << 24).value());
  EXPECT_TRUE(ReadEdgedExr(TestPath("a.exr"))->edges.channels().empty());
  EXPECT_TRUE(ReadEdgedExr(TestPath("a.exr"))->fragments.channels().empty());
}

TEST(Exr, RefusesAPictureWithoutPixelsOrChannels) {
  EXPECT_EQ(WriteExr(TestPath("a.exr"), LayeredImage(4, 4)).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(WriteExr(TestPath("a.exr"), LayeredImage()).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Exr, RefusesAFileCutShortAnywhere) {
  const std::string path = TestPath("a.exr");
  ASSERT_TRUE(WriteExr(path, SampleImage(64, 64)).ok());
  const std::string bytes = ReadFile(path, 1 << 24).value();
  for (const size_t keep :
       {size_t{0}, size_t{3}, size_t{40}, bytes.size() / 3, bytes.size() / 2, bytes.size() - 1}) {
    ASSERT_TRUE(WriteFileAtomically(path, bytes.substr(0, keep)).ok());
    const auto read = ReadExr(path);
    EXPECT_EQ(read.status().code(), absl::StatusCode::kInvalidArgument) << keep << " of " << bytes.size();
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(path));
  }
}

/// A small file whose header says that its last pixel is (x, y).
std::string ClaimingLastPixel(const std::string& path, uint32_t x, uint32_t y) {
  EXPECT_TRUE(WriteExr(path, SampleImage(8, 8)).ok());
  std::string bytes = ReadFile(path, 1 << 24).value();
  const std::string attribute("dataWindow\0box2i\0", 17);
  const size_t at = bytes.find(attribute);
  EXPECT_NE(at, std::string::npos);
  const size_t max_x = at + attribute.size() + 4 + 8;  // size, min.x, min.y
  for (int i = 0; i < 4; ++i) {
    bytes[max_x + i] = static_cast<char>(x >> (8 * i));
    bytes[max_x + 4 + i] = static_cast<char>(y >> (8 * i));
  }
  return bytes;
}

TEST(Exr, RefusesAHugeDataWindowBeforeAllocating) {
  const std::string path = TestPath("a.exr");
  const int64_t before = PeakMemoryBytes();
  for (const auto& [x, y] : {std::pair(0xfffffu, 0xfffffu),
                             {0xfffu, 0xfffu},
                             {0xfffffu, 0u},
                             {0u, 0xfffffu},
                             {0x7ffffffeu, 0u},
                             {0u, 0x7ffffffeu},
                             {0x7ffffffeu, 0x7ffffffeu}}) {
    const std::string bytes = ClaimingLastPixel(path, x, y);
    ASSERT_TRUE(WriteFileAtomically(path, bytes).ok());
    for (const absl::Status& status : {ReadExr(path).status(), DecodeExr(path, bytes).status()}) {
      EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
      EXPECT_THAT(std::string(status.message()), HasSubstr(path));
    }
  }
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
}

TEST(Exr, NamesWhatAFileClaimsAndWhatItHas) {
  const std::string path = TestPath("a.exr");
  const std::string bytes = ClaimingLastPixel(path, 0xfffff, 7);
  EXPECT_EQ(
      DecodeExr("sky.exr", bytes).status().message(),
      absl::StrCat("sky.exr: claims 1048576x8 pixels of 6 channels, but has only ", bytes.size(), " bytes"));
}

TEST(Exr, TellsMissingFromNotAPicture) {
  EXPECT_EQ(ReadExr(TestPath("missing.exr")).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(ReadExr(::testing::TempDir()).status().code(), absl::StatusCode::kInvalidArgument);
  ASSERT_TRUE(WriteFileAtomically(TestPath("text.exr"), "hello, I am text\n").ok());
  EXPECT_EQ(ReadExr(TestPath("text.exr")).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace lumifold
