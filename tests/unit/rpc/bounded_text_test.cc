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

TEST(Printable, TextOfOthersCannotMoveTheCursor) {
  EXPECT_EQ(Printable("Stuhl \xc3\xa4 \xf0\x9f\xaa\x91"), "Stuhl \xc3\xa4 \xf0\x9f\xaa\x91");
  EXPECT_EQ(Printable("a\nb\x1b[2K\x7f"), "a\\nb\\x1b[2K\\x7f");
  EXPECT_EQ(Printable("\xc2\x9b"
                      "A\xff\xe4"),
            "\\xc2\\x9bA\\xff\\xe4")
      << "a control character of two bytes";
}

TEST(AsUtf8, BytesThatAreNoneAreReplaced) {
  EXPECT_EQ(AsUtf8("oak \xe6\xa4\x85.glb"), "oak \xe6\xa4\x85.glb");
  EXPECT_EQ(AsUtf8("st\xfchl"), "st\xef\xbf\xbdhl") << "Latin 1";
  EXPECT_EQ(AsUtf8("\xc0\x80"), "\xef\xbf\xbd\xef\xbf\xbd") << "overlong";
  EXPECT_EQ(AsUtf8("\xed\xa0\x80"), "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd") << "a surrogate";
  EXPECT_EQ(AsUtf8("a\xe6\xa4"), "a\xef\xbf\xbd\xef\xbf\xbd") << "cut short";
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
