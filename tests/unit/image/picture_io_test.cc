#include "filter/image/picture_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "filter/image/exr_io.h"
#include "filter/image/file_io.h"
#include "tests/support/temp_folder.h"

namespace lumifold {
namespace {

using ::testing::HasSubstr;

std::string ExrBytes(const LayeredImage& image) {
  const TempFolder folder;
  const std::string path = folder.PathOf("picture.exr");
  EXPECT_TRUE(WriteExr(path, image).ok());
  return *ReadFile(path, 1 << 20);
}

TEST(LinearPicture, ReadsOpenExrFromMemory) {
  LayeredImage image(5, 3);
  const ColorView color = image.AddColor("");
  image.Add("A");
  color[1].At(4, 2) = 7;
  const auto read = DecodeLinearPicture("sky.exr", ExrBytes(image));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->bounds(), image.bounds());
  EXPECT_EQ(read->channels().size(), 3u);
  EXPECT_EQ(read->Get("G").At(4, 2), 7);
  EXPECT_EQ(read->Get("R").At(4, 2), 0);
}

TEST(LinearPicture, GreyStandsForAllColours) {
  LayeredImage image(2, 2);
  image.Add("Y").At(1, 1) = 3;
  const auto read = DecodeLinearPicture("sky.exr", ExrBytes(image));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("B").At(1, 1), 3);
}

TEST(LinearPicture, ReadsRadiance) {
  const auto read = DecodeLinearPicture("sky", "#?RADIANCE\n\n-Y 1 +X 1\n\x40\x40\x40\x82");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->Get("R").At(0, 0), 1);
}

TEST(LinearPicture, NamesWhatIsWrong) {
  EXPECT_THAT(std::string(DecodeLinearPicture("sky.png", "\x89PNG").status().message()),
              HasSubstr("sky.png: neither"));
  LayeredImage depth(2, 2);
  depth.Add("Z");
  EXPECT_THAT(std::string(DecodeLinearPicture("z.exr", ExrBytes(depth)).status().message()),
              HasSubstr("z.exr: has neither channels"));
}

TEST(LinearPicture, SurvivesDamagedOpenExr) {
  LayeredImage image(16, 8);
  image.AddColor("");
  const std::string good = ExrBytes(image);
  for (size_t length = 0; length < good.size(); length += 3) {
    EXPECT_FALSE(DecodeLinearPicture("sky.exr", good.substr(0, length)).ok()) << length;
  }
  std::mt19937 random(3);
  for (int i = 0; i < 300; ++i) {
    std::string bad = good;
    bad[random() % bad.size()] = static_cast<char>(random());
    if (const auto read = DecodeLinearPicture("sky.exr", bad); read.ok()) {
      EXPECT_LE(int64_t{read->width()} * read->height(), kMaxPixels);
    }
  }
}

}  // namespace
}  // namespace lumifold
