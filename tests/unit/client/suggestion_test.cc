#include "client/cli/suggestion.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

TEST(EditDistance, CountsInsertionsDeletionsReplacementsAndSwaps) {
  EXPECT_EQ(EditDistance("", ""), 0);
  EXPECT_EQ(EditDistance("render", "render"), 0);
  EXPECT_EQ(EditDistance("", "abc"), 3);
  EXPECT_EQ(EditDistance("rendr", "render"), 1);
  EXPECT_EQ(EditDistance("rrender", "render"), 1);
  EXPECT_EQ(EditDistance("rander", "render"), 1);
  EXPECT_EQ(EditDistance("redner", "render"), 1);
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3);
}

TEST(Suggestion, NamesTheNearestWord) {
  const std::vector<std::string> words = {"render", "submit", "status", "wait", "watch"};
  EXPECT_EQ(Suggestion("rendr", words), "; did you mean 'render'?");
  EXPECT_EQ(Suggestion("wach", words), "; did you mean 'watch'?");
}

TEST(Suggestion, StaysSilentWhereNothingIsNear) {
  const std::vector<std::string> words = {"render", "submit", "list"};
  EXPECT_EQ(Suggestion("frobnicate", words), "");
  EXPECT_EQ(Suggestion("x", words), "");
  EXPECT_EQ(Suggestion("", words), "");
  EXPECT_EQ(Suggestion("render", {}), "");
}

}  // namespace
}  // namespace lumifold::client
