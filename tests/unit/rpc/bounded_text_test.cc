#include "proto/rpc/bounded_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace lumifold::rpc {
namespace {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::SizeIs;

TEST(BoundedText, ALineThatFitsIsUnchanged) {
  EXPECT_EQ(BoundedLine("", 64), "");
  EXPECT_EQ(BoundedLine(std::string(64, 'a'), 64), std::string(64, 'a'));
  EXPECT_EQ(BoundedLine("a\tb\nc\x7f", 64), "a b c ");
}

TEST(BoundedText, ALongLineSaysHowMuchIsLeftOut) {
  EXPECT_EQ(BoundedLine(std::string(65, 'a'), 64), "aaaaaaaaaaaaaaaa... (49 bytes left out)");
  EXPECT_THAT(BoundedLine(std::string(size_t{1} << 22, 'a'), 64), EndsWith("... (4194288 bytes left out)"));
}

TEST(BoundedText, CharactersAreNotCut) {
  std::string text = "x";
  for (int i = 0; i < 100; ++i) text += "\xc3\xa4";
  const std::string line = BoundedLine(text, 64);
  EXPECT_EQ(line, text.substr(0, 15) + "... (186 bytes left out)");
  EXPECT_EQ(BoundedLine(line, 64), line);
}

TEST(BoundedText, EachLineOnceAndTheRestCounted) {
  EXPECT_THAT(BoundedLines(std::vector<std::string>{"b", "a", "b"}, 2, 64), ElementsAre("b", "a"));
  const std::vector<std::string> five = {"b", "a", "b", "c", "d", "e"};
  const std::vector<std::string> bounded = BoundedLines(five, 3, 64);
  EXPECT_THAT(bounded, ElementsAre("b", "a", "3 further warnings are left out"));
  EXPECT_EQ(BoundedLines(bounded, 3, 64), bounded);
  EXPECT_THAT(BoundedLines(std::vector<std::string>(100'000, "same"), 3, 64), SizeIs(1));
}

}  // namespace
}  // namespace lumifold::rpc
