#include "worker/scene/uri.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/percent_decoding_cases.h"

namespace lumifold::scene {
namespace {

TEST(Uri, DecodesPercentSigns) {
  for (const auto& [encoded, decoded] : kPercentDecodingCases) EXPECT_EQ(PercentDecode(encoded), decoded);
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
