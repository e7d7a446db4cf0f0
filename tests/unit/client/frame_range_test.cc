#include "client/cli/frame_range.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

TEST(FrameRange, RefusesWhatIsNoRangeAndSaysWhatIsExpected) {
  for (const char* text : {"",   "-",    "1-",   "5-4", "1-2-3", "a",          "1-b",
                           " 1", "1 -2", "+1",   "1.5", "1..3",  "2147483647", "0-99999999999",
                           "1,", ",1",   "1,,2", "3,2", "1-4,4", "7,7",        "1, 2"}) {
    EXPECT_EQ(ParseFrames(text).status(),
              absl::InvalidArgumentError(
                  "expected frames such as 7, 1-48, 1-48,60 or 1-100x10 in ascending order; got '" +
                  std::string(text) + "'"));
  }
}

TEST(FrameRange, ReadsOneFrameOrSeveralWithGaps) {
  EXPECT_EQ(ParseFrames("7").value(), (Frames{{{7, 7}}}));
  EXPECT_EQ(ParseFrames("1-48").value(), (Frames{{{1, 48}}}));
  EXPECT_EQ(ParseFrames("0012-0012").value(), (Frames{{{12, 12}}}));
  EXPECT_EQ(ParseFrames("1-48,60,70-72").value(), (Frames{{{1, 48}, {60, 60}, {70, 72}}}));
  EXPECT_EQ((FrameRange{1, 48}).count(), 48);
}

TEST(FrameRange, ReadsStepsAsOtherFarmsWriteThem) {
  for (const char* text : {"1-10x4", "1-10:4", "1-9x4"})
    EXPECT_EQ(ParseFrames(text).value(), (Frames{{{1, 1}, {5, 5}, {9, 9}}})) << text;
  EXPECT_EQ(ParseFrames("1-10x1").value(), (Frames{{{1, 10}}}));
  EXPECT_EQ(ParseFrames("1-3x2,7").value(), (Frames{{{1, 1}, {3, 3}, {7, 7}}}));
  EXPECT_TRUE(ParseFrames("1-2049x2").ok());
  EXPECT_EQ(ParseFrames("1-2051x2").status().message(),
            "'1-2051x2' has more than 1025 ranges: submit it as several jobs");
}

TEST(FrameRange, ReadsFramesBeforeZero) {
  EXPECT_EQ(ParseFrames("-5").value(), (Frames{{{-5, -5}}}));
  EXPECT_EQ(ParseFrames("-5--1").value(), (Frames{{{-5, -1}}}));
  EXPECT_EQ(ParseFrames("-5-3x4").value(), (Frames{{{-5, -5}, {-1, -1}, {3, 3}}}));
}

TEST(PathOfFrame, FillsTheRunOfTheFileName) {
  EXPECT_EQ(PathOfFrame("out.####.exr", 7), "out.0007.exr");
  EXPECT_EQ(PathOfFrame("out#.exr", 123), "out123.exr");
  EXPECT_EQ(PathOfFrame("shot##/v#_###.png", 12), "shot##/v#_012.png");
}

TEST(PathOfFrame, LeavesOtherNamesAlone) {
  for (const char* path : {"out.exr", "shot##/out.exr", "", "chair #3.exr", "#1 oak.png"}) {
    EXPECT_EQ(PathOfFrame(path, 3), path);
    EXPECT_FALSE(HasFrameNumber(path)) << path;
  }
  EXPECT_TRUE(HasFrameNumber("shot/#"));
}

}  // namespace
}  // namespace lumifold::client
