#include "proto/rpc/rect_codec.h"

#include <gtest/gtest.h>

namespace lumifold::rpc {
namespace {

TEST(ParseRect, TakesWhatRectTextMakes) {
  const Rect rect = {3, 0, 17, 2147483647};
  EXPECT_EQ(RectText(rect), "3,0,17,2147483647");
  EXPECT_EQ(ParseRect(RectText(rect)), rect);
  EXPECT_EQ(RectOf(ProtoOf(rect)), rect);
}

TEST(ParseRect, RefusesWhatIsNoRectangleOfPixels) {
  for (const char* text :
       {"", "1,2,3", "1,2,3,4,5", "1,2,x,4", "-1,0,4,4", "4,0,4,4", "0,5,4,4", "0,0,4,2147483648", "1;2;3;4"})
    EXPECT_FALSE(ParseRect(text).has_value()) << text;
}

}  // namespace
}  // namespace lumifold::rpc
