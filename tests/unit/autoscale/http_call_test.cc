#include "client/autoscale/http_call.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::autoscale {
namespace {

TEST(HttpCall, NamesTheUrlWhereNobodyListens) {
  const auto answer = CallHttp({.url = "http://127.0.0.1:1/x"});
  EXPECT_EQ(answer.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(answer.status().message()), testing::HasSubstr("http://127.0.0.1:1/x"));
}

TEST(HttpCall, ReadsNoFiles) {
  EXPECT_EQ(CallHttp({.url = "file:///etc/hostname"}).status().code(), absl::StatusCode::kUnavailable);
}

TEST(HttpCall, EscapesQueries) { EXPECT_EQ(UrlEscape("app=a b,c&d"), "app%3Da%20b%2Cc%26d"); }

}  // namespace
}  // namespace lumifold::autoscale
