#include "client/cli/picture_size.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

TEST(PictureSize, RefusesWhatIsNoSizeAndSaysWhatIsExpected) {
  for (const char* text :
       {"", "x", "0", "16385", "512x", "x384", "0x384", "512x0", "-512x384", "+5x5", " 5x5", "5x5 ", "5 x5",
        "16385x1", "99999999999x1", "512X384", "512x384x3", "5.0x5"}) {
    const auto size = ParsePictureSize(text);
    ASSERT_FALSE(size.ok()) << text;
    EXPECT_EQ(size.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(size.status().message(),
              std::string("expected WIDTHxHEIGHT or WIDTH in pixels, 1 to 16384 each, such as "
                          "512x384; got '") +
                  text + "'");
  }
}

TEST(PictureSize, ReadsWidthThenHeight) {
  EXPECT_EQ(ParsePictureSize("512x384").value(), (PictureSize{512, 384}));
  EXPECT_EQ(ParsePictureSize("1x16384").value(), (PictureSize{1, 16384}));
  EXPECT_EQ(ParsePictureSize("512").value(), (PictureSize{512, 0}));
}

}  // namespace
}  // namespace lumifold::client
