#include "worker/scene/uri.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::scene {
namespace {

TEST(Uri, DecodesPercentSignsButNotPlus) {
  EXPECT_EQ(PercentDecode("wood%20floor+1.png"), "wood floor+1.png");
  EXPECT_EQ(PercentDecode("%C3%a4.bin"), "\xC3\xA4.bin");
}

TEST(Uri, LeavesMalformedPercentSigns) {
  for (const char* text : {"%", "100%", "%4", "%zz.bin", "a%2"}) EXPECT_EQ(PercentDecode(text), text);
}

TEST(Uri, DecodesBase64Data) {
  EXPECT_EQ(*DecodeDataUri("data:application/octet-stream;base64,AAEC/w=="), std::string("\0\1\2\xff", 4));
  EXPECT_EQ(*DecodeDataUri("DATA:;base64,"), "");
}

TEST(Uri, DecodesPercentEncodedData) { EXPECT_EQ(*DecodeDataUri("data:,a%20b"), "a b"); }

TEST(Uri, RefusesMalformedData) {
  EXPECT_EQ(DecodeDataUri("data:;base64").status().message(), "a data: URI without a comma");
  EXPECT_EQ(DecodeDataUri("data:;base64,AAE*").status().message(), "a data: URI that is not valid base64");
  EXPECT_TRUE(IsDataUri("data:,x"));
  EXPECT_FALSE(IsDataUri("database.bin"));
}

}  // namespace
}  // namespace lumifold::scene
