#include "proto/http/message.h"

#include <gtest/gtest.h>

namespace lumifold::http {
namespace {

TEST(HttpRequest, FindsHeadersInAnyCase) {
  const Request request = {.headers = {{"Content-Type", "a"}, {"CONTENT-TYPE", "b"}, {"Empty", ""}}};
  EXPECT_EQ(request.Header("content-type"), "a");
  EXPECT_EQ(request.Header("Empty"), "");
  EXPECT_EQ(request.Header("Content"), "");
}

TEST(HttpRequest, DecodesParameters) {
  const Request request = {
      .query = "a=1&region=0%2C0%2c16,9&text=x+y%2B&%6E=v&none&a=2&wrong=%&more=%4&no=5%zz&==&n=&"};
  EXPECT_EQ(request.Parameter("a"), "1");
  EXPECT_EQ(request.Parameter("region"), "0,0,16,9");
  EXPECT_EQ(request.Parameter("text"), "x y+");
  EXPECT_EQ(request.Parameter("n"), "v");
  EXPECT_EQ(request.Parameter("none"), "");
  EXPECT_EQ(request.Parameter("wrong"), "%");
  EXPECT_EQ(request.Parameter("more"), "%4");
  EXPECT_EQ(request.Parameter("no"), "5%zz");
  EXPECT_EQ(request.Parameter("other"), std::nullopt);
  EXPECT_EQ(Request().Parameter("a"), std::nullopt);
}

}  // namespace
}  // namespace lumifold::http
