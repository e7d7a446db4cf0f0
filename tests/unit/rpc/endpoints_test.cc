#include "proto/rpc/endpoints.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

namespace lumifold::rpc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Endpoints, KeepsTheOrderOfTheList) {
  EXPECT_THAT(*ParseEndpoints("a:7700"), ElementsAre("a:7700"));
  EXPECT_THAT(*ParseEndpoints("b:7700,a:7701,[::1]:7700,unix:/run/lumifold"),
              ElementsAre("b:7700", "a:7701", "[::1]:7700", "unix:/run/lumifold"));
  EXPECT_THAT(*ParseEndpoints(" a:1 , b:2"), ElementsAre("a:1", "b:2"));
}

TEST(Endpoints, OneHostWithTwoPortsIsTwo) {
  EXPECT_THAT(*ParseEndpoints("a:7700,a:7701"), ElementsAre("a:7700", "a:7701"));
}

TEST(Endpoints, NamesWhatIsMalformed) {
  for (const char* wrong :
       {"", ":7700", "a", "a:", "a:x", "a:0", "a:65536", "::1:7700", "unix:", "a:1 b:2"}) {
    for (const std::string& list : {std::string(wrong), absl::StrCat("good:7700,", wrong)}) {
      const auto parsed = ParseEndpoints(list);
      EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument) << list;
      EXPECT_THAT(std::string(parsed.status().message()), HasSubstr(absl::StrCat("'", wrong, "'"))) << list;
    }
  }
}

TEST(Endpoints, RefusesAnEmptyEntry) {
  for (const char* list : {",", "a:1,", ",a:1", "a:1,,b:2", "a:1, ,b:2"}) {
    EXPECT_EQ(ParseEndpoints(list).status().code(), absl::StatusCode::kInvalidArgument) << list;
  }
}

TEST(Endpoints, RefusesOneTwice) {
  const auto parsed = ParseEndpoints("a:7700,b:7700, a:7700");
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(parsed.status().message()), HasSubstr("'a:7700' is twice"));
}

TEST(Endpoints, HasALimit) {
  std::string list = "a:1";
  for (size_t i = 2; i <= kMaxEndpoints; ++i) absl::StrAppend(&list, ",a:", i);
  EXPECT_EQ(ParseEndpoints(list)->size(), kMaxEndpoints);
  const auto parsed = ParseEndpoints(absl::StrCat(list, ",b:1"));
  EXPECT_EQ(parsed.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(parsed.status().message()), HasSubstr("more than 16"));
}

}  // namespace
}  // namespace lumifold::rpc
