#include "filter/image/hdr_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "tests/support/peak_memory.h"

namespace lumifold {
namespace {

using ::testing::HasSubstr;

std::string Head(const std::string& resolution, const std::string& more = "") {
  return "#?RADIANCE\n" + more + "FORMAT=32-bit_rle_rgbe\n\n" + resolution + "\n";
}

std::string Bytes(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes += static_cast<char>(value);
  return bytes;
}

std::string ErrorOf(const std::string& bytes) {
  const auto read = DecodeHdr("sky.hdr", bytes);
  EXPECT_FALSE(read.ok());
  EXPECT_EQ(read.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(read.status().message()), ::testing::StartsWith("sky.hdr: "));
  return std::string(read.status().message());
}

TEST(Hdr, ReadsFlatPixels) {
  // Mantissa m and exponent e stand for m * 2^(e - 136).
  const auto read =
      DecodeHdr("sky.hdr", Head("-Y 1 +X 2") + Bytes({128, 64, 32, 129}) + Bytes({200, 100, 50, 0}));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(0, 0), 1.0f);
  EXPECT_EQ(read->Get("G").At(0, 0), 0.5f);
  EXPECT_EQ(read->Get("B").At(0, 0), 0.25f);
  EXPECT_EQ(read->Get("R").At(1, 0), 0.0f);  // exponent 0 is black
}

TEST(Hdr, ReadsLinesThatEndAsOnWindows) {
  const auto read =
      DecodeHdr("sky.hdr", "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\nEXPOSURE=2\r\n\r\n-Y 1 +X 1\r\n" +
                               Bytes({128, 64, 32, 130}));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(0, 0), 1.0f);
  EXPECT_EQ(read->Get("B").At(0, 0), 0.25f);
}

TEST(Hdr, ReadsXyz) {
  // Equal energy is white; the red primary, x = .64 and y = .33, is red alone; a spectral green is cut off.
  const auto read = DecodeHdr("sky.hdr", "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 3\n" +
                                             Bytes({128, 128, 128, 129, 192, 99, 9, 129, 20, 200, 40, 129}));
  ASSERT_TRUE(read.ok()) << read.status();
  for (const char* channel : {"R", "G", "B"}) EXPECT_NEAR(read->Get(channel).At(0, 0), 1, 1e-6f) << channel;
  EXPECT_GT(read->Get("R").At(1, 0), 2.5f);
  EXPECT_NEAR(read->Get("G").At(1, 0), 0, 0.01f);
  EXPECT_NEAR(read->Get("B").At(1, 0), 0, 0.01f);
  EXPECT_EQ(read->Get("R").At(2, 0), 0);
  EXPECT_GT(read->Get("G").At(2, 0), 2.5f);
}

TEST(Hdr, ReadsOldRuns) {
  const auto read = DecodeHdr("sky.hdr", Head("-Y 1 +X 260") + Bytes({128, 0, 0, 129}) +
                                             Bytes({1, 1, 1, 2, 1, 1, 1, 1}) + Bytes({0, 128, 0, 129}));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(258, 0), 1.0f);
  EXPECT_EQ(read->Get("G").At(258, 0), 0.0f);
  EXPECT_EQ(read->Get("G").At(259, 0), 1.0f);
}

TEST(Hdr, ReadsNewRuns) {
  const std::string line = Bytes({2, 2, 0, 10}) + Bytes({138, 128}) +  // R: ten times 128
                           Bytes({3, 0, 64, 128, 135, 0}) +            // G: three values, a run
                           Bytes({138, 0}) + Bytes({138, 129});
  const auto read = DecodeHdr("sky.hdr", Head("-Y 2 +X 10") + line + line);
  ASSERT_TRUE(read.ok()) << read.status();
  for (int x = 0; x < 10; ++x) EXPECT_EQ(read->Get("R").At(x, 1), 1.0f);
  EXPECT_EQ(read->Get("G").At(1, 1), 0.5f);
  EXPECT_EQ(read->Get("G").At(2, 0), 1.0f);
  EXPECT_EQ(read->Get("G").At(3, 0), 0.0f);
}

TEST(Hdr, TurnsEveryOrientationUpright) {
  // The picture has one bright pixel, top left; the position of the file's first pixel follows from the
  // orientation.
  struct Case {
    const char* resolution;
    int bright;
  };
  for (const Case& c :
       {Case{"-Y 2 +X 2", 0}, Case{"-Y 2 -X 2", 1}, Case{"+Y 2 +X 2", 2}, Case{"+Y 2 -X 2", 3},
        Case{"+X 2 -Y 2", 0}, Case{"+X 2 +Y 2", 1}, Case{"-X 2 -Y 2", 2}, Case{"-X 2 +Y 2", 3}}) {
    std::string pixels;
    for (int i = 0; i < 4; ++i) pixels += Bytes({i == c.bright ? 128 : 0, 0, 0, 129});
    const auto read = DecodeHdr("sky.hdr", Head(c.resolution) + pixels);
    ASSERT_TRUE(read.ok()) << c.resolution;
    EXPECT_EQ(read->Get("R").At(0, 0), 1.0f) << c.resolution;
  }
}

TEST(Hdr, TakesTheExposureOut) {
  const auto read =
      DecodeHdr("sky.hdr", Head("-Y 1 +X 1", "EXPOSURE= 2\nEXPOSURE=2\n") + Bytes({128, 0, 0, 129}));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(0, 0), 0.25f);
}

TEST(Hdr, RefusesWhatIsNoWholePicture) {
  EXPECT_THAT(ErrorOf(""), HasSubstr("not a Radiance picture"));
  EXPECT_THAT(ErrorOf("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n"), HasSubstr("within its header"));
  EXPECT_THAT(ErrorOf("#?RADIANCE\nFORMAT=32-bit_rle_cmyk\n\n-Y 1 +X 1\n1234"), HasSubstr("cmyk"));
  const std::string long_format = ErrorOf("#?RADIANCE\nFORMAT=\x01" + std::string(5000, 'x') + "\n");
  EXPECT_THAT(long_format, HasSubstr("its format \\x01xxx"));
  EXPECT_LT(long_format.size(), 500u);
  EXPECT_THAT(ErrorOf(Head("-Y 1 +X 1", "EXPOSURE=0\n") + "1234"), HasSubstr("EXPOSURE"));
  for (const char* resolution : {"", "-Y 0 +X 4", "-Y 4", "-Y 4 +Y 4", "-Y x +X 4", "-Y -4 +X 4"}) {
    EXPECT_THAT(ErrorOf(Head(resolution) + "1234"), HasSubstr("resolution")) << resolution;
  }
  EXPECT_THAT(ErrorOf(Head("-Y 1000000 +X 1000000")), HasSubstr("more than is read"));
  EXPECT_THAT(ErrorOf(Head("-Y 20 +X 20") + "1234"), HasSubstr("cut short"));
  EXPECT_THAT(ErrorOf(Head("-Y 1 +X 2") + Bytes({1, 1, 1, 1, 0, 0, 0, 0})), HasSubstr("line 0"));
  EXPECT_THAT(ErrorOf(Head("-Y 1 +X 10") + Bytes({2, 2, 0, 10, 139, 1})), HasSubstr("line 0"));
  EXPECT_THAT(ErrorOf(Head("-Y 1 +X 10") + Bytes({2, 2, 0, 10, 0, 0})), HasSubstr("line 0"));
  EXPECT_THAT(ErrorOf(Head("-Y 1 +X 10") + Bytes({2, 2, 0, 9, 138, 1})), HasSubstr("line 0"));
}

TEST(Hdr, RefusesMorePixelsThanTheBytesCanHoldBeforeAllocating) {
  const int64_t before = PeakMemoryBytes();
  for (const char* resolution : {"-Y 16384 +X 16384", "-Y 1 +X 268435456", "-X 1 +Y 268435456"})
    EXPECT_THAT(ErrorOf(Head(resolution) + "1234"), HasSubstr(" pixels, but has only ")) << resolution;
  EXPECT_LT(PeakMemoryBytes() - before, kRefusalBytes);
}

TEST(Hdr, SurvivesAnyDamage) {
  const std::string line = Bytes({2, 2, 0, 10, 138, 128, 3, 0, 64, 128, 135, 0, 138, 0, 138, 129});
  const std::string good = Head("-Y 3 +X 10") + line + line + line;
  ASSERT_TRUE(DecodeHdr("sky.hdr", good).ok());
  for (size_t length = 0; length < good.size(); ++length) {
    EXPECT_FALSE(DecodeHdr("sky.hdr", good.substr(0, length)).ok()) << length;
  }
  std::mt19937 random(7);
  for (int i = 0; i < 20000; ++i) {
    std::string bad = good;
    for (int k = 0; k < 3; ++k) bad[random() % bad.size()] = static_cast<char>(random());
    if (const auto read = DecodeHdr("sky.hdr", bad); read.ok()) {
      EXPECT_GT(read->width(), 0);
    }
  }
}

}  // namespace
}  // namespace lumifold
